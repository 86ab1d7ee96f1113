"""What a study's results depend on, as digests: rows of different studies never stand in one table."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pkmsea.description import find
from pkmsea.study.study import Study

PACKAGES = ("pkmsea", "casadi", "pin", "numpy", "scipy")
NOT_RESULTS: Any = {"results": True, "name": True, "vary": {"__all__": {"label"}}}  # keys that change no solution


def fingerprint(study: Study) -> dict[str, str]:
    """Digests of study file, task and mechanisms, and the packages' versions."""
    sources = [find(study.base.mechanism_source(setup)) for setup in study.base.setups]
    return {
        "study file": _digest(study.model_dump_json(exclude=NOT_RESULTS).encode()),
        "task": _digest(study.base.model_dump_json().encode()),
        "mechanism": _digest(*(content for source in sorted(set(sources)) for content in _contents(source))),
        "versions": ", ".join(f"{name} {version(name)}" for name in PACKAGES),
    }


def _contents(source: Path) -> list[bytes]:
    files = sorted(path for path in source.iterdir() if path.is_file()) if source.is_dir() else [source]
    return [file.read_bytes() for file in files]


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"\0".join(contents)).hexdigest()
