"""Stage functions as machine code for several instants at once, kept in the user's cache directory by content.

Without a C++ compiler the functions run in CasADi's interpreter, about ten times slower, with one hint.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from pathlib import Path

import casadi as ca
import platformdirs

log = logging.getLogger(__name__)
FLAGS = ("-std=c++17", "-O2", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi")
SWITCH = "PKMSEA_COMPILE"  # set to 0 to stay with the interpreter
TIME_LIMIT = 300.0  # [s] for the compiler
LANES = Path(__file__).with_name("lanes.hpp")

Kernel = Callable[..., None]  # (count, pointers to the inputs' rows, pointers to the outputs' rows)


@lru_cache(maxsize=64)
def kernels(functions: tuple[ca.Function, ...]) -> list[Kernel | None]:
    """Machine code for each Function at many instants; None for all where there is no compiler.

    The cache's key is their content, the compiler with all that it knows of this processor, and the flags.
    """
    compiler, folder = _compiler(), _folder()
    if compiler is None or folder is None:
        return [None] * len(functions)
    content = "\n".join([*(f.serialize() for f in functions), LANES.read_text(), ca.__version__, *compiler, *FLAGS])
    library = folder / f"{hashlib.sha256(content.encode()).hexdigest()}.so"
    try:
        if not _intact(library):
            _build(functions, library, compiler)
        code = ctypes.CDLL(str(library))
    except subprocess.CalledProcessError as error:
        _hint(f"the C++ compiler {compiler[0]} failed: {_first_error(error.stderr)}")
        return [None] * len(functions)
    except (OSError, subprocess.TimeoutExpired) as error:
        _hint(f"the C++ compiler's library cannot be had ({error})")
        return [None] * len(functions)
    return [getattr(code, f"{f.name()}_everywhere") for f in functions]


@cache
def _compiler() -> tuple[str, str, str] | None:
    """Path of the C++ compiler, its flag for this processor, and its macros, which tell its version and that."""
    if os.environ.get(SWITCH) == "0":
        return None
    for name in (os.environ.get("CXX", ""), "c++", "g++", "clang++"):
        path = shutil.which(name) if name else None
        if path is None:
            continue
        for flag in ("-march=native", "-mcpu=native"):
            asked = [path, flag, "-dM", "-E", "-x", "c++", os.devnull]
            answer = subprocess.run(asked, capture_output=True, text=True, check=False)
            if answer.returncode == 0:
                return path, flag, answer.stdout
    _hint("there is no C++ compiler")
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


def _build(functions: Sequence[ca.Function], library: Path, compiler: tuple[str, str, str]) -> None:
    """Generate and compile in a folder of its own, then move the library into place whole."""
    generator = ca.CodeGenerator("stage.cpp", {"cpp": True})
    for function in functions:
        generator.add(function)
    source = "\n".join([LANES.read_text(), generator.dump(), *(_everywhere(f) for f in functions)])
    with tempfile.TemporaryDirectory(dir=library.parent) as name:
        text, built, digest = (Path(name) / file for file in ("stage.cpp", "stage.so", "digest"))
        text.write_text(source)
        command = [compiler[0], compiler[1], *FLAGS, str(text), "-o", str(built)]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=TIME_LIMIT)
        digest.write_text(_digest(built))
        digest.replace(library.with_suffix(".sha256"))
        built.replace(library)


def _everywhere(f: ca.Function) -> str:
    """C++ text of `<name>_everywhere`, which runs f at many instants."""
    rows = [f.numel_in(i) for i in range(f.n_in())], [f.numel_out(i) for i in range(f.n_out())]
    shape = f"{len(rows[0])}, {len(rows[1])}, {sum(rows[0]) + sum(rows[1])}"
    sizes = ", ".join(f"{{{', '.join(map(str, sizes))}}}" for sizes in rows)
    return f"""
extern "C" void {f.name()}_everywhere(long count, const double* const* in, double* const* out) {{
  lanes::run<{shape}>({f.name()}, count, in, out, {sizes});
}}"""


def _first_error(messages: str) -> str:
    return next((line.strip() for line in messages.splitlines() if "error:" in line), "it gives no reason")


def _intact(library: Path) -> bool:
    """Whether a cached library is there and is what was built."""
    digest = library.with_suffix(".sha256")
    if not library.is_file() or library.is_symlink() or not digest.is_file():
        return False
    return digest.read_bytes() == _digest(library).encode()


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


@cache
def _hint(why: str) -> None:
    log.warning("%s: solving goes on in CasADi's interpreter, about ten times slower", why)
