"""Files: reading and checking the YAML that people write, naming file, key, value and remedy; writing them whole."""

from __future__ import annotations

import contextlib
import glob
import os
import re
import tempfile
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_args

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator
from pydantic_core import ErrorDetails

from pkmsea.errors import InputError, Unwritable, listed, meant, one_line

MAX_BYTES = 1_000_000  # a mechanism or task file has a few kB; more is not one of ours
MAX_DEPTH = 20  # lists and mappings inside each other; a task file has 7
LONGEST = 120  # bytes of a file name without suffix; file systems allow 255 of the whole
PARTIAL = ".part"  # suffix of files that are being written; nothing reads them
LEFT_OVER = 3600.0  # [s] after which a partial file is that of a killed process: none takes that long to write


class Record(BaseModel):
    """Base of all file records: frozen, no unknown keys, no NaN or infinity, no truth for a number."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _true_is_no_number(cls, data: Any) -> Any:
        """Where no truth is asked for, true is the text 'true', which is no number."""
        if not isinstance(data, dict):
            return data
        kinds = {name: field.annotation for name, field in cls.model_fields.items()}
        return {
            key: value if key not in kinds or _asks_for(bool, kinds[key]) else _as_text(value, not _records(kinds[key]))
            for key, value in data.items()
        }

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """What differs from the defaults."""
        for name, field in type(self).model_fields.items():
            if (value := getattr(self, name)) != field.get_default(call_default_factory=True, validated_data={}):
                yield name, value

    def __repr__(self) -> str:
        return one_line(super().__repr__())


class FromFile(Record):
    """A record that has a file of its own; its copies keep it."""

    _file: Path | None = PrivateAttr(None)

    @property
    def file(self) -> Path | None:
        """Where it was read from."""
        return self._file

    def read_from(self, file: str | Path | None) -> Self:
        """This record with its file: for one that came another way."""
        self._file = Path(file) if file else None
        return self

    def beside(self, name: str) -> Path:
        """A path that the file names: relative to the file's folder if it is there, else to the working directory."""
        path = (self.file.parent if self.file else Path()) / name
        return path if os.path.exists(path) else Path(name)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("this name has characters that cannot be printed")
    return text


Printable = Annotated[str, Field(max_length=200), AfterValidator(_printable)]
Name = Annotated[Printable, Field(min_length=1)]
R = TypeVar("R", bound=Record)
F = TypeVar("F", bound=FromFile)


class _Loader(yaml.SafeLoader):
    """Safe loading without aliases, which can blow a small file up to any size, deep nesting, and doubled keys.

    Plain words mean what they do in YAML 1.2: PyYAML would read 010 as eight, 1:30 as ninety, 1e-3 as text, and a joint
    named `on` as true.
    """

    _depth = 0
    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}  # type: ignore[misc]

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            raise yaml.constructor.ConstructorError(None, None, "aliases (*name) are not read here", mark)
        if self._depth >= MAX_DEPTH:
            raise yaml.constructor.ConstructorError(None, None, f"more than {MAX_DEPTH} levels of nesting", mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                message = f"the key '{key}' stands twice"
                raise yaml.constructor.ConstructorError(None, None, message, key_node.start_mark)
            if isinstance(key, str):
                seen.add(key)
        return super().construct_mapping(node, deep)


_DECIMAL = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
for _kind, _pattern, _first in (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", "true|True|false|False", list("tTfF")),
    ("int", "[-+]?[0-9]+", list("+-0123456789")),
    ("float", rf"{_DECIMAL}|[-+]?\.(inf|Inf)|\.(nan|NaN)", list("+-.0123456789")),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(rf"^({_pattern})$"), _first)
_Loader.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(loader.construct_scalar(node)))  # type: ignore[arg-type]


def read_yaml(path: Path) -> Any:
    """The content of a YAML file as plain Python data."""
    if not is_file(path):
        raise InputError("The file does not exist.", "Check the path.", file=path)
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"The file is larger than {MAX_BYTES} bytes.", "Give a mechanism or task file.", file=path)
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except OSError as error:
        raise InputError(f"The file cannot be read ({error.strerror}).", "Check its rights.", file=path) from error
    except UnicodeDecodeError as error:
        raise InputError(f"The file is not UTF-8 text ({error.reason}).", "Save it as UTF-8.", file=path) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The file is not valid YAML: {cause}.", "Mend that line.", file=path) from error


def is_file(path: Path) -> bool:
    """Whether there is a file; False for a name that is too long, where pathlib 3.11 raises like its `exists`."""
    return os.path.isfile(path)


def parse(kind: type[R], data: Any, file: Path | str | None) -> R:
    """Check plain data against a record type.

    Raises
    ------
    InputError : names the first offending key, its value and what is expected there.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise _input_error(kind, error, data, file) from None


def read(kind: type[F], path: Path) -> F:
    """Read a YAML file as one record."""
    return parse(kind, read_yaml(path), path).read_from(path)


def file_name(title: str, among: Sequence[str] = ()) -> str:
    """A safe file name, without suffix, from a title: 'PKM SEA' becomes 'PKM_SEA'.

    Titles that stand `among` others never share one, whatever the case of letters: the second gets '-2', and so on.
    """
    taken: set[str] = set()
    for other in among or (title,):
        plain = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFKC", other)).strip("._")
        plain = plain.encode()[:LONGEST].decode(errors="ignore") or "setup"
        free = next(x for x in chain([plain], (f"{plain}-{i}" for i in count(2))) if x.casefold() not in taken)
        if other == title:
            return free
        taken.add(free.casefold())
    raise ValueError(f"'{title}' is not among {among}")


def _input_error(kind: type[Record], error: ValidationError, data: Any, file: Path | str | None) -> InputError:
    # of the branches of a union, the one that got deepest is what was meant; there a wrong type says least
    first = max(error.errors(), key=lambda fault: (len(_path(data, fault)), not fault["type"].endswith("_type")))
    path = _path(data, first)
    key = ".".join(str(part) for part in path) or None
    what = re.sub(
        r"\d+(\.\d+)?$", lambda number: f"{float(number[0]):.12g}", first["msg"].removeprefix("Value error, ")
    )
    if first["type"] == "extra_forbidden":
        fields = _fields_at(kind, path[:-1])
        remedy = f"Remove it or use one of: {listed(fields)}." if fields else "Remove it or correct its name."
        remedy = meant(str(path[-1]), fields) + remedy
        return InputError("This key is not known.", remedy, file=file, key=key)
    if first["type"] == "missing":
        return InputError("This key is missing.", "Add it; 'pkmsea schema' prints what it may be.", file=file, key=key)
    remedy = "Correct this value; 'pkmsea schema' prints what is allowed."
    return InputError(f"{what.rstrip('.')}.", remedy, file=file, key=key, value=first["input"] if key else None)


def _path(data: Any, fault: ErrorDetails) -> list[Any]:
    """The part of a fault's location that stands in the file, without the names of union branches."""
    path: list[Any] = []
    for part in fault["loc"]:
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]
            path.append(part)
    return [*path, fault["loc"][-1]] if fault["type"] == "missing" else path


def _fields_at(kind: Any, path: list[Any]) -> list[str]:
    """Field names of the record that `path` leads to; records inside lists and unions are found."""
    records = _records(kind)
    for part in path:
        if isinstance(part, str):
            fields = [record.model_fields[part] for record in records if part in record.model_fields]
            records = [inner for field in fields for inner in _records(field.annotation)]
    return sorted({name for record in records for name in record.model_fields})


def _asks_for(kind: type, annotation: Any) -> bool:
    return annotation is kind or any(_asks_for(kind, inner) for inner in get_args(annotation))


def _as_text(value: Any, mappings: bool) -> Any:
    """A value with true and false as texts, also in lists and, unless they are records, in mappings."""
    if isinstance(value, dict) and mappings:
        return {key: _as_text(inner, mappings) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_as_text(inner, mappings) for inner in value]
    return str(value).lower() if isinstance(value, bool) else value


def _records(annotation: Any) -> list[type[BaseModel]]:
    """All record types in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for inner in get_args(annotation) for record in _records(inner)]


def write_whole(path: Path, write: Callable[[Path], Any]) -> None:
    """Call `write` with a temporary path beside `path` and rename it: the file is there whole, or not at all.

    The temporary is hidden and ends in PARTIAL, whatever the suffix of `path`. Only a killed process leaves one; it
    goes when the same file is written again after LEFT_OVER.

    Raises
    ------
    Unwritable : the file cannot be written.
    """
    with _partial(path) as temporary:
        write(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)


def check_writable(folder: Path) -> None:
    """Make sure, before long work, that its results can be written to a folder, which is made.

    Raises
    ------
    Unwritable : they cannot.
    """
    with _partial(folder / "result") as temporary:
        temporary.write_bytes(bytes(1))


@contextlib.contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """A fresh temporary file beside `path`, gone in the end; errors of the system become typed ones."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for other in path.parent.glob(f".{glob.escape(path.name)}-*{PARTIAL}"):
            with contextlib.suppress(FileNotFoundError):
                if time.time() - other.stat().st_mtime > LEFT_OVER:
                    other.unlink()
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-", suffix=PARTIAL)
        os.close(handle)
        try:
            yield Path(name)
        finally:
            Path(name).unlink(missing_ok=True)
    except OSError as error:
        raise Unwritable(
            f"The file cannot be written ({error.strerror or error}).",
            "Choose another folder, or make room on the disk.",
            file=path,
        ) from error
