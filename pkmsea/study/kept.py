"""Numbers that cost a search, kept as JSON files by what they depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from pkmsea.files import write_whole


def kept(folder: Path, depends_on: str, search: Callable[[], float]) -> float:
    """The number that a search has found for this text before, else what it finds now."""
    file = folder / f"{hashlib.sha256(depends_on.encode()).hexdigest()}.json"
    try:
        return float(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        number = search()
        write_whole(file, lambda temporary: temporary.write_text(json.dumps(number), encoding="utf-8"))
        return number
