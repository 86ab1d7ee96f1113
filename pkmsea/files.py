"""Reading and checking the YAML files that people write; every fault names file, key, value and remedy."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from pkmsea.errors import InputError

MAX_BYTES = 1_000_000  # a mechanism or task file has a few kB; more is not one of ours


class Record(BaseModel):
    """Base of all file records: frozen, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


R = TypeVar("R", bound=Record)


class _Loader(yaml.SafeLoader):
    """Safe loading without aliases, which can blow a small file up to any size, and without doubled keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.constructor.ConstructorError(None, None, "aliases (*name) are not read here", event.start_mark)
        return super().compose_node(parent, index)

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


def read_yaml(path: Path) -> Any:
    """The content of a YAML file as plain Python data."""
    if not path.is_file():
        raise InputError("The file does not exist.", "Check the path.", file=path)
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"The file is larger than {MAX_BYTES} bytes.", "Give a mechanism or task file.", file=path)
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except UnicodeDecodeError as error:
        raise InputError(f"The file is not UTF-8 text ({error.reason}).", "Save it as UTF-8.", file=path) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The file is not valid YAML: {cause}.", "Mend that line.", file=path) from error


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


def read(kind: type[R], path: Path) -> R:
    """Read a YAML file as one record."""
    return parse(kind, read_yaml(path), path)


def file_name(title: str) -> str:
    """A safe file name from a title: 'PKM SEA' becomes 'PKM_SEA'."""
    return re.sub(r"[^\w.+-]+", "_", title).strip("._") or "setup"


def _input_error(kind: type[Record], error: ValidationError, data: Any, file: Path | str | None) -> InputError:
    # of the branches of a union, the one that got deepest is what was meant
    first = max(error.errors(), key=lambda fault: len(_path(data, fault["loc"])))
    path = _path(data, first["loc"])
    key = ".".join(str(part) for part in path) or None
    what = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        fields = ", ".join(_fields_at(kind, path[:-1]))
        remedy = f"Remove it or use one of: {fields}." if fields else "Remove it or correct its name."
        return InputError("This key is not known.", remedy, file=file, key=key)
    if first["type"] == "missing":
        return InputError("This key is missing.", "Add it; 'pkmsea schema' prints what it may be.", file=file, key=key)
    remedy = "Correct this value; 'pkmsea schema' prints what is allowed."
    return InputError(f"{what.rstrip('.')}.", remedy, file=file, key=key, value=first["input"] if key else None)


def _path(data: Any, loc: tuple[Any, ...]) -> list[Any]:
    """The part of a fault's location that stands in the file, without the names of union branches."""
    path: list[Any] = []
    for i, part in enumerate(loc):
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]
            path.append(part)
        elif i + 1 == len(loc) and isinstance(data, dict):
            path.append(part)  # a missing key
    return path


def _fields_at(kind: Any, path: list[Any]) -> list[str]:
    """Field names of the record that `path` leads to; records inside lists and unions are found."""
    records = _records(kind)
    for part in path:
        if isinstance(part, str):
            fields = [record.model_fields[part] for record in records if part in record.model_fields]
            records = [inner for field in fields for inner in _records(field.annotation)]
    return sorted({name for record in records for name in record.model_fields})


def _records(annotation: Any) -> list[type[BaseModel]]:
    """All record types in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for inner in get_args(annotation) for record in _records(inner)]
