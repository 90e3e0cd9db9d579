"""Sixteen float32 numbers in a vector register, for kernels that numba does not vectorise well.

Each lane is computed as the scalar is, rounded once an operation (IEEE 754), so a kernel's bits are those of the same
arithmetic one by one. A processor with narrower registers works a vector in parts.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 16
ir = cgutils.ir  # of llvmlite, which numba brings
_FORM = ir.VectorType(ir.FloatType(), LANES)


class Vector(types.Type):  # type: ignore[misc]
    """Type of a vector in a kernel."""

    def __init__(self) -> None:
        super().__init__(name="float32x16")


VECTOR = Vector()


@register_model(Vector)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager, kind) -> None:  # type: ignore[no-untyped-def]
        super().__init__(manager, kind, _FORM)


@intrinsic
def fma(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a * b + c with one rounding, float32."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    return types.float32(types.float32, types.float32, types.float32), generate


def _spread(builder: Any, value: Any) -> Any:
    one = builder.insert_element(ir.Constant(_FORM, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


@intrinsic
def spread(typing_context, value):  # type: ignore[no-untyped-def]
    """Return a float32 in every lane."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _spread(builder, *arguments)

    return VECTOR(types.float32), generate


@intrinsic
def fma_all(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a * b + c with one rounding in each lane; b and c are vectors, a is one, or a float32."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        kind = ir.FunctionType(_FORM, [_FORM, _FORM, _FORM])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f32")
        first = arguments[0] if signature.args[0] == VECTOR else _spread(builder, arguments[0])
        return builder.call(function, [first, *arguments[1:]])

    return VECTOR(VECTOR if a == VECTOR else types.float32, VECTOR, VECTOR), generate


def _place(context: Any, builder: Any, array_type: Any, array: Any, place: Any) -> Any:
    own = context.make_array(array_type)(context, builder, array)
    indices = cgutils.unpack_tuple(builder, place)
    pointer = cgutils.get_item_pointer(context, builder, array_type, own, indices, wraparound=False)
    return builder.bitcast(pointer, _FORM.as_pointer())


@intrinsic
def load(typing_context, array, place):  # type: ignore[no-untyped-def]
    """Return the sixteen numbers of a contiguous float32 array from a place (a tuple of indices) on, unchecked."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        pointer = _place(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=4)

    return VECTOR(array, place), generate


@intrinsic
def store(typing_context, array, place, value):  # type: ignore[no-untyped-def]
    """Write a vector to a contiguous float32 array from a place (a tuple of indices) on, unchecked."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        pointer = _place(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, place, VECTOR), generate


def product(rows: int, vectors: int, lanes: int = LANES) -> Any:
    """Return what a kernel calls to add to a part of an array the matrix product of parts of two others, float32.

    `(x, x_place, w, w_place, out, out_place, depth)`: out's `rows` rows by `vectors` * `lanes` columns from a place on
    get x's so many rows by `depth` columns times w's `depth` rows. Places are tuples of an index an axis, of which the
    last two are rows and columns; all of it is unchecked. The sums stay in registers, and each has one accumulator,
    which gets its products in the order of the depth, each rounded once: the same bits whatever the shape.
    """
    form = ir.VectorType(ir.FloatType(), lanes)
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)

    @intrinsic
    def add_product(typing_context, x, x_place, w, w_place, out, out_place, depth):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            def part(kind: Any, array: Any, place: Any, row: Any, column: Any) -> Any:
                own = context.make_array(kind)(context, builder, array)
                *outer, i, j = cgutils.unpack_tuple(builder, place)
                indices = [*outer, builder.add(i, row), builder.add(j, column)]
                return cgutils.get_item_pointer(context, builder, kind, own, indices, wraparound=False)

            def whole(pointer: Any) -> Any:
                return builder.bitcast(pointer, form.as_pointer())

            x_kind, _, w_kind, _, out_kind, _, _ = signature.args
            x_array, x_at, w_array, w_at, out_array, out_at, count = arguments
            index = count.type
            places = [(r, v) for r in range(rows) for v in range(vectors)]
            targets = [
                whole(part(out_kind, out_array, out_at, ir.Constant(index, r), ir.Constant(index, v * lanes)))
                for r, v in places
            ]
            sums = [cgutils.alloca_once_value(builder, builder.load(target, align=4)) for target in targets]
            kind = ir.FunctionType(form, [form, form, form])
            fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{lanes}f32")
            with cgutils.for_range(builder, count) as loop:
                weights = [
                    builder.load(whole(part(w_kind, w_array, w_at, loop.index, ir.Constant(index, v * lanes))), align=4)
                    for v in range(vectors)
                ]
                for r in range(rows):
                    one = builder.load(part(x_kind, x_array, x_at, ir.Constant(index, r), loop.index))
                    first = builder.insert_element(ir.Constant(form, ir.Undefined), one, ir.Constant(ir.IntType(32), 0))
                    spread_out = builder.shuffle_vector(first, first, zeros)
                    for v in range(vectors):
                        place = sums[r * vectors + v]
                        builder.store(builder.call(fused, [spread_out, weights[v], builder.load(place)]), place)
            for target, place in zip(targets, sums, strict=True):
                builder.store(builder.load(place), target, align=4)
            return context.get_dummy_value()

        return types.void(x, x_place, w, w_place, out, out_place, depth), generate

    return add_product


@intrinsic
def power_of_two(typing_context, n):  # type: ignore[no-untyped-def]
    """Return 2**n as float32, for whole n from -126 to 127."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        exponent = builder.add(builder.trunc(arguments[0], ir.IntType(32)), ir.Constant(ir.IntType(32), 127))
        return builder.bitcast(builder.shl(exponent, ir.Constant(ir.IntType(32), 23)), ir.FloatType())

    return types.float32(types.int64), generate
