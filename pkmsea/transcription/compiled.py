"""Stage functions as machine code, compiled once and kept in the user's cache directory by content.

Without a C compiler the functions run in CasADi's interpreter, three to five times slower, with one hint.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as ca
import platformdirs

log = logging.getLogger(__name__)
FLAGS = ("-O2", "-fPIC", "-shared", "-fno-math-errno")
SWITCH = "PKMSEA_COMPILE"  # set to 0 to stay with the interpreter
TIME_LIMIT = 300.0  # [s] for the compiler


def compile_functions(functions: Sequence[ca.Function]) -> list[ca.Function]:
    """The same functions, compiled if that is possible; cached by their content, compiler and flags."""
    compiler, folder = _compiler(), _folder()
    if compiler is None or folder is None:
        return list(functions)
    content = "\n".join([*(f.serialize() for f in functions), ca.__version__, *compiler, *FLAGS, platform.machine()])
    library = folder / f"{hashlib.sha256(content.encode()).hexdigest()}.so"
    if not _intact(library):
        try:
            _build(functions, library, compiler[0])
        except (OSError, subprocess.SubprocessError) as error:
            _hint(f"the C compiler failed ({error})")
            return list(functions)
    return [ca.external(f.name(), str(library)) for f in functions]


@cache
def _compiler() -> tuple[str, str] | None:
    """Path and version of the C compiler."""
    if os.environ.get(SWITCH) == "0":
        return None
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path is not None:
            asked = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
            return path, asked.stdout.split("\n")[0]
    _hint("there is no C compiler")
    return None


@cache
def _folder() -> Path | None:
    """The cache folder, if it belongs to this user alone."""
    folder = Path(platformdirs.user_cache_dir("pkmsea")) / "functions"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
    except OSError as error:
        _hint(f"the cache folder {folder} cannot be used ({error.strerror})")
        return None
    others = stat.S_IWGRP | stat.S_IWOTH
    owned = not hasattr(os, "getuid") or state.st_uid == os.getuid()
    if not stat.S_ISDIR(state.st_mode) or not owned or state.st_mode & others:
        _hint(f"the cache folder {folder} does not belong to this user alone")
        return None
    return folder


def _build(functions: Sequence[ca.Function], library: Path, compiler: str) -> None:
    """Generate and compile in a folder of its own, then move the library into place whole."""
    generator = ca.CodeGenerator("stage.c")
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory(dir=library.parent) as name:
        generator.generate(name + os.sep)
        built = Path(name) / "stage.so"
        command = [compiler, *FLAGS, str(Path(name) / "stage.c"), "-o", str(built), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=TIME_LIMIT)
        digest = Path(name) / "digest"
        digest.write_text(_digest(built))
        digest.replace(library.with_suffix(".sha256"))
        built.replace(library)


def _intact(library: Path) -> bool:
    """Whether a cached library is there and is what was built."""
    digest = library.with_suffix(".sha256")
    if not library.is_file() or library.is_symlink() or not digest.is_file():
        return False
    return digest.read_text() == _digest(library)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


@cache
def _hint(why: str) -> None:
    log.warning("%s: solving goes on in CasADi's interpreter, three to five times slower", why)
