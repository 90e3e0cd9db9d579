"""Self-describing Parquet files: unit and description in every field, a JSON document in the schema."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from vpsci_ros.documents import parse_json, path_in_utf8, reason, refuse_pointer, require_form, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write

METADATA_KEY = b"vpsci_ros"


MOST_VALUES = 2**27  # that are read at once: 1 GiB in memory; compressed, ten times as many fit into 20 MB
MOST_TEXT = 2**30  # [bytes] of texts read at once; a text that a file stores once may be the value of every row


class Column(NamedTuple):
    """One column of a table: its type in memory, its unit ("" if it has none) and its meaning."""

    dtype: type[pl.DataType]
    unit: str
    description: str


def arrow_schema(columns: Mapping[str, Column], metadata: Mapping[str, Any]) -> pa.Schema:
    """Return the schema of a file: types and units of `columns`, and `metadata` as JSON under the key "vpsci_ros"."""
    empty = pl.DataFrame(schema={name: column.dtype for name, column in columns.items()}).to_arrow()
    fields = [
        field.with_nullable(False).with_metadata(
            {"unit": columns[field.name].unit, "description": columns[field.name].description}
        )
        for field in empty.schema
    ]
    return pa.schema(fields, metadata={METADATA_KEY: json.dumps(metadata, sort_keys=True).encode()})


def write_parquet(table: pl.DataFrame, path: str | Path, columns: Mapping[str, Column], **metadata: Any) -> None:
    """Write `table` (zstd) with exactly `columns`, whole or not at all.

    :raises InvalidInput: the folder of `path` does not exist.
    """
    schema = arrow_schema(columns, metadata)
    with atomic_write(path) as part:
        arrow = table.select(list(columns)).to_arrow().cast(schema)
        single = [field.name for field in schema if pa.types.is_float32(field.type)]  # bytes of like weight together
        own = {"use_byte_stream_split": single, "use_dictionary": [n for n in schema.names if n not in single]}
        pq.write_table(arrow, part, compression="zstd", **(own if single else {}))


def read_parquet(path: str | Path, what: str, columns: Iterable[str] = ()) -> pl.DataFrame:
    """Read a Parquet file by Arrow, which refuses a damaged file on which polars would panic.

    :param what: what the file should hold, for the error message.
    :param columns: it must have, and that are returned; none: all that it has.
    :raises InvalidInput: no such file, not Parquet, damaged, or a column is missing.
    """
    path = Path(path)
    require_regular(path)
    if path.is_dir():
        raise InvalidInput(f"{path}: a folder; expected {what} in Parquet (`vpsci import` makes one of recordings)")
    if not path.is_file():
        raise InvalidInput(f"{path}: no such file; expected {what} in Parquet")
    refuse_pointer(path)
    try:
        with open_parquet(path) as file:
            table = read_bounded(file)
    except (pa.ArrowException, pl.exceptions.PolarsError, OSError, ValueError, TypeError) as error:
        raise InvalidInput(f"{path}: expected {what} in Parquet, not readable as such: {reason(error)}") from error
    if missing := [name for name in columns if name not in table.columns]:
        has = ", ".join(table.columns) or "none"
        raise InvalidInput(f"{path}: expected {what}; column {', '.join(missing)} is missing, it has {has}")
    return table.select(list(columns)) if columns else table


def open_parquet(path: str | Path) -> pq.ParquetFile:
    """Open a Parquet file for `read_bounded`; a text that many rows have is read once.

    :raises ValueError: a column holds neither numbers, times nor texts.
    """
    texts = []
    with path_in_utf8(path) as name:
        for field in pq.read_schema(name):
            if any(holds(field.type) for holds in _TEXTS):
                texts.append(field.name)
            elif pa.types.is_nested(field.type) or pa.types.is_fixed_size_binary(field.type):
                raise ValueError(f"column {field.name} is of type {field.type}; expected numbers, times or texts")
        return pq.ParquetFile(name, page_checksum_verification=True, read_dictionary=texts)


def read_bounded(file: pq.ParquetFile, group: int | None = None) -> pl.DataFrame:
    """Return the table in a file of `open_parquet`, or in one of its row groups.

    :raises ValueError: more values than `MOST_VALUES`, or more text than `MOST_TEXT`, see also `as_polars`.
    """
    rows = file.metadata.num_rows if group is None else file.metadata.row_group(group).num_rows
    if rows * file.metadata.num_columns > MOST_VALUES:
        raise ValueError(
            f"{rows:,} rows of {file.metadata.num_columns} columns; expected {MOST_VALUES:,} values at most"
        )
    groups = range(file.metadata.num_row_groups) if group is None else [group]
    _require_little(sum(file.metadata.row_group(each).total_byte_size for each in groups))
    table = file.read() if group is None else file.read_row_group(group)
    _require_little(sum(_length(column) for column in table.columns if _is_coded(column.type)))
    plain = [column.cast(column.type.value_type) if _is_coded(column.type) else column for column in table.columns]
    return as_polars(pa.Table.from_arrays(plain, names=table.column_names))


_TEXTS = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)


def _is_coded(kind: pa.DataType) -> bool:
    return bool(pa.types.is_dictionary(kind)) and any(holds(kind.value_type) for holds in _TEXTS)


def _length(column: pa.ChunkedArray) -> float:
    """Return the bytes of a column's texts when every row has a copy of its text."""
    total = 0.0
    for chunk in column.chunks:
        counts = pc.value_counts(chunk.indices.drop_null())
        lengths = pc.binary_length(chunk.dictionary).fill_null(0).take(counts.field("values"))
        total += float(counts.field("counts").to_numpy().astype(float) @ lengths.to_numpy().astype(float))
    return total


def _require_little(text: float) -> None:
    if text > MOST_TEXT:
        raise ValueError(f"{text / 1e6:,.0f} MB unpacked; expected {MOST_TEXT / 1e6:,.0f} MB at most")


def as_polars(table: pa.Table) -> pl.DataFrame:
    """Return an Arrow table as a polars table; column names must be in UTF-8, since polars would panic.

    :raises ValueError: a name is not in UTF-8.
    """
    _ = table.schema.names  # are decoded here
    made = pl.from_arrow(table)
    assert isinstance(made, pl.DataFrame), "a table becomes a table"
    return made


def read_metadata(path: str | Path) -> dict[str, Any]:
    """Return the JSON document that `write_parquet` stored; empty for a file written by something else.

    :raises InvalidInput: not Parquet, or what is stored is no JSON.
    """
    require_regular(path)
    try:
        with path_in_utf8(path) as name:
            stored = (pq.read_schema(name).metadata or {}).get(METADATA_KEY)
    except (pa.ArrowException, OSError) as error:
        raise InvalidInput(f"{path}: not readable as Parquet: {reason(error)}") from error
    values = parse_json(stored, f"{path}, metadata") if stored else {}
    require_form(values, dict, f"{path}, metadata")
    return dict(values)
