"""Keys with dots: places in plain data, as the files have them."""

from __future__ import annotations

from typing import Any


class Missing(Exception):
    """A key leads nowhere; `names` are those that exist where it ends."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(names)
        self.names = names


def assign(data: Any, path: list[str], number: float) -> None:
    """Replace what stands at a path of keys and indices in plain data; * stands for every entry of a list."""
    if isinstance(data, dict):
        for end in range(1, len(path) + 1):  # a key may have dots itself
            key = ".".join(path[:end])
            if key in data:
                break
        else:
            raise Missing(list(data))
        rest: list[str] = path[end:]
        if not rest and isinstance(data[key], dict | list) and "bounds" not in data[key]:
            raise Missing([f"{key}.{inner}" for inner in _names(data[key])])
        places: list[Any] = [key]
    elif isinstance(data, list):
        if path[0] != "*" and not (path[0].isdigit() and int(path[0]) < len(data)):
            raise Missing(["*", *map(str, range(len(data)))])
        places = list(range(len(data))) if path[0] == "*" else [int(path[0])]
        rest = path[1:]
    else:
        raise Missing([])
    for place in places:
        if rest:
            assign(data[place], rest, number)
        else:
            data[place] = number


def _names(data: Any) -> list[str]:
    return list(data) if isinstance(data, dict) else ["*", *map(str, range(len(data)))]
