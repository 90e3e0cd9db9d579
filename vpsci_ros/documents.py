"""Reading of YAML and JSON files from others, with limits so that no content can hang or crash a program.

Of YAML the part is read that ROS 2 reads of its parameter files: no aliases (a few hundred bytes of them unfold to
billions of values), no tags but the plain ones, no key twice (PyYAML keeps the last one without a word).
"""

import codecs
import contextlib
import json
import os
import re
import reprlib
import stat
from collections.abc import Hashable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from vpsci_ros.errors import InvalidInput

Form = type | tuple[type, ...] | Mapping[str, Any] | list[Any]
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same, in C, where PyYAML was built with it
_FAULTS = (yaml.YAMLError, ValueError, TypeError, AttributeError, LookupError, OverflowError)  # of its resolvers, too
_UNNAMED = 'in "<unicode string>", '  # as PyYAML calls what is no file
_ANY = "*"
DEEPEST = 50  # levels of a YAML document
LONGEST = 2**26  # [bytes] of a text that is read as a whole
LONGEST_YAML = 2**22  # [bytes] of a YAML file, which takes two seconds a megabyte
_FOREIGN = {
    b"version https://git-lfs": "a Git LFS pointer, not the file itself: run `git lfs pull` where it was cloned",
    b"\x1f\x8b": "compressed by gzip: unpack it first",
    b"PK\x03\x04": "a ZIP archive or a spreadsheet: unpack it, or save the sheet as CSV",
    b"PAR1": "a Parquet file: end its name with .parquet",
    b"SQLite format 3\0": "an SQLite database: `ros2 bag convert` or its own program writes another format",
    b"<": "XML or HTML: export its tracks as CSV",
    b"{": "JSON: export its rows as CSV",
    b"[": "JSON: export its rows as CSV",
}
"""How files of other kinds begin -> what each is, and what to do."""
OUTPUTS: set[Path] = set()
"""Files that the running command is to write; no file is read that is one of them, by whatever path."""
_REPR = reprlib.Repr()
_REPR.maxlevel, _REPR.maxlist, _REPR.maxdict, _REPR.maxstring, _REPR.maxother, _REPR.maxlong = 3, 6, 6, 120, 120, 60


def shown(value: Any) -> str:
    """Return a value for an error message: its `repr`, with long and deeply nested parts shortened."""
    try:
        return _REPR.repr(value)
    except ValueError:  # a number of more digits than Python writes out
        return f"a {type(value).__name__} too long to write out"


def listed(names: Iterable[object], most: int = 8) -> str:
    """Return names for an error message: at most `most`, and the total number if there are more; "none" for none."""
    texts = [str(name) for name in names]
    return ", ".join(texts[:most] + [f"... {len(texts)} in all"] * (len(texts) > most)) or "none"


def counted(count: int, one: str, many: str = "") -> str:
    """Return a number with its noun: "1 near miss", "2 near misses"; `many` is by default `one` with an s."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def given_names(text: str, where: str) -> list[str]:
    """Return the names in a comma-separated text, in order; [] for an empty text.

    :raises InvalidInput: a name is empty, as in "a,,b" or "a,"; `where` opens the message.
    """
    names = [part.strip() for part in text.split(",")] if text else []
    if not all(names):
        raise InvalidInput(f"{where} {text!r}: expected names with a comma between two of them, got an empty one")
    return names


def reason(error: BaseException) -> str:
    """Return an exception's message in one line, cut after 300 characters; its class name if the message is empty."""
    text = " ".join(str(error).replace(_UNNAMED, "").split()) or type(error).__name__
    return text if len(text) <= 300 else f"{text[:300]} ..."


class _Loader(_LOADER):  # type: ignore[misc]
    """YAML loader that refuses a mapping with one key twice, and whole numbers of more than 64 bits."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                continue  # the construction below says so
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {shown(key)} is there twice; keep one", key_node.start_mark
                )
            seen.add(key)
        made: dict[Any, Any] = super().construct_mapping(node, deep)
        return made

    def construct_yaml_int(self, node: Any) -> int:
        return _bounded(super().construct_yaml_int(node))


_Loader.add_implicit_resolver(  # 1e-9 is a number for ROS 2, as in YAML 1.2, but a text in PyYAML's YAML 1.1
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def _bounded(value: int) -> int:
    """Return a whole number, of 64 bits at most: ROS 2, Parquet and floats hold no greater ones.

    :raises ValueError: it needs more than 64 bits.
    """
    if not -(2**63) <= value < 2**64:
        raise ValueError(f"a whole number of {len(str(abs(value)))} digits; expected one of 64 bits at most")
    return value


def parse_yaml(text: str, where: str) -> Any:
    """Return the values of a YAML text.

    :param where: what it comes from, the opening of the error message.
    :raises InvalidInput: not YAML, or outside the part of YAML that this module reads, see its docstring.
    """
    try:
        _refuse_bombs(text)
        return yaml.load(text, _Loader)
    except _FAULTS as error:
        raise InvalidInput(f"{where}: not readable as YAML: {reason(error)}") from None


def _refuse_bombs(text: str) -> None:
    """Refuse aliases, and nesting deeper than `DEEPEST`: very deep texts overflow the stack of the loader in C."""
    depth = 0
    for event in yaml.parse(text, _LOADER):
        if isinstance(event, yaml.AliasEvent):
            raise yaml.composer.ComposerError(
                None,
                None,
                f"an alias (*{event.anchor}), which ROS 2 does not read either; write it out",
                event.start_mark,
            )
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise yaml.composer.ComposerError(None, None, f"nested deeper than {DEEPEST}", event.start_mark)


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    """YAML writer without aliases and lone surrogates, which neither this module nor ROS 2 reads."""

    def ignore_aliases(self, data: object) -> bool:
        return True

    def represent_str(self, data: str) -> yaml.Node:
        return super().represent_str(in_utf8(data))


_Dumper.add_representer(str, _Dumper.represent_str)


def dump_yaml(value: Any) -> str:
    """Return plain values as a YAML text that `parse_yaml` reads, with keys in their given order."""
    return str(yaml.dump(value, Dumper=_Dumper, sort_keys=False))


def read_yaml(path: str | Path) -> Any:
    """Return the values of a YAML file.

    :raises InvalidInput: it cannot be read, or see `parse_yaml`.
    """
    return parse_yaml(read_text(path, "YAML", LONGEST_YAML), str(path))


def require_regular(path: str | Path, most: int = 2**40) -> None:
    """Refuse a pipe, a device or a socket, a file of more than `most` bytes, and an input that is one of `OUTPUTS`.

    A file that is not there, or a folder, is left to what opens it.

    :raises InvalidInput: see above, or the path holds a NUL.
    """
    try:
        status = Path(path).stat()
    except OSError:
        return
    except ValueError as error:  # a NUL in it
        raise InvalidInput(f"{shown(str(path))}: expected the path of a file: {reason(error)}") from None
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
        raise InvalidInput(f"{path}: expected a file, found a pipe, a device or a socket; copy its content to a file")
    for output in OUTPUTS:
        if output.exists() and os.path.samestat(output.stat(), status):
            raise InvalidInput(f"{output}: the output would replace an input, {path}; choose another output path")
    if status.st_size > most:
        raise InvalidInput(f"{path}: {status.st_size / 1e6:,.0f} MB; expected {most / 1e6:,.0f} MB at most")


def in_utf8(text: str) -> str:
    """Return a text in which bytes that are not UTF-8, which a path may have, are escaped; else the text itself."""
    return text.encode("utf-8", "backslashreplace").decode()


@contextlib.contextmanager
def path_in_utf8(path: str | Path) -> Iterator[str]:
    """Yield the path of a file to read, for a library in C++ or Rust; where it is not UTF-8, that of the open file."""
    if in_utf8(str(path)) == str(path):
        yield str(path)
        return
    with Path(path).open("rb") as file:
        yield f"/proc/self/fd/{file.fileno()}"


def foreign(data: bytes) -> str:
    """Return what a file is and what to do, if its first bytes are those of another kind of file; "" otherwise."""
    begin = data[:256].removeprefix(codecs.BOM_UTF8).lstrip()
    return next((what for mark, what in _FOREIGN.items() if begin.startswith(mark)), "")


def refuse_pointer(path: str | Path) -> None:
    """Refuse a file that holds a Git LFS pointer.

    :raises InvalidInput: says what to run.
    """
    try:
        with Path(path).open("rb") as file:
            what = foreign(file.read(64))
    except OSError:
        return
    if "LFS" in what:
        raise InvalidInput(f"{path}: {what}")


def printable(text: str) -> str:
    """Return a text with all unprintable characters escaped, except line breaks and tabs."""
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def read_text(path: str | Path, what: str, most: int | None = None) -> str:
    """Return the text of a file; refuse a file of more than `most` bytes (default: `LONGEST`).

    :raises InvalidInput: it cannot be read, is too large, or is not UTF-8.
    """
    require_regular(path, most or LONGEST)
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidInput(f"{path}: not readable as {what}: {error.strerror or reason(error)}") from error
    except ValueError as error:
        raise InvalidInput(f"{path}: not readable as {what}: not text in UTF-8 ({reason(error)})") from None


def parse_json(text: str | bytes, where: str) -> Any:
    """Return the values of a JSON text.

    :raises InvalidInput: not JSON, nested too deeply, or a number of more than 64 bits; `where` opens the message.
    """
    try:
        return json.loads(text, parse_int=lambda digits: _bounded(int(digits)))
    except RecursionError:
        raise InvalidInput(f"{where}: not readable as JSON: nested too deeply") from None
    except ValueError as error:
        raise InvalidInput(f"{where}: not readable as JSON: {reason(error)}") from None


def read_json(path: str | Path) -> Any:
    """Return the values of a JSON file.

    :raises InvalidInput: it cannot be read, or see `parse_json`.
    """
    return parse_json(read_text(path, "JSON"), str(path))


def require_form(value: Any, form: Form, where: str) -> None:
    """Refuse a value without the required keys and types; further keys are allowed.

    :param form: a type, several, or a mapping of keys to forms in turn, in which "*" stands for every key; or a list
        of the form that every entry has.
    :raises InvalidInput: names the place, what is expected there, and what is there.
    """
    if isinstance(form, Mapping):
        if not isinstance(value, Mapping):
            raise InvalidInput(f"{where}: expected a mapping, got {shown(value)}")
        for key, below in form.items():
            if key == _ANY:
                for name, part in value.items():
                    require_form(part, below, f"{where}, {name}")
            elif key not in value:
                raise InvalidInput(f"{where}: {key} is missing; it has {', '.join(map(str, value)) or 'nothing'}")
            else:
                require_form(value[key], below, f"{where}, {key}")
    elif isinstance(form, list):
        require_form(value, list, where)
        for entry in value:
            require_form(entry, form[0], where)
    elif not isinstance(value, form) or (isinstance(value, bool) and form is int):
        kinds = form if isinstance(form, tuple) else (form,)
        raise InvalidInput(f"{where}: expected {' or '.join(k.__name__ for k in kinds)}, got {shown(value)}")
