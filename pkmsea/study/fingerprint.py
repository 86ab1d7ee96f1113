"""What a study's results depend on, as digests: rows of different studies never stand in one table."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from typing import Any

from pkmsea.description import find, read
from pkmsea.study.study import Study

PACKAGES = ("pkmsea", "casadi", "pin", "numpy", "scipy")
NOT_RESULTS: Any = {"results": True, "name": True, "vary": {"__all__": {"label"}}}  # keys that change no solution


def fingerprint(study: Study) -> dict[str, str]:
    """Digests of study file, task and mechanisms, and the packages' versions."""
    sources = {find(study.base.mechanism_source(setup)) for setup in study.base.setups}
    return {
        "study file": _digest(study.model_dump_json(exclude=NOT_RESULTS).encode()),
        "task": _digest(study.base.model_dump_json().encode()),
        "mechanism": _digest(*(read(source).digest.encode() for source in sorted(sources))),
        "versions": versions(),
    }


@cache
def versions() -> str:
    """The packages on which results depend."""
    return ", ".join(f"{name} {version(name)}" for name in PACKAGES)


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"\0".join(contents)).hexdigest()
