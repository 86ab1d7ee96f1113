"""Stage functions as machine code: same numbers as CasADi's interpreter, and a cache that survives abuse."""

import logging
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pkmsea.transcription import compiled
from pkmsea.transcription.batch import Batch

COUNT = 37  # instants; no multiple of any number of lanes


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of this test's own."""
    monkeypatch.setattr(compiled.platformdirs, "user_cache_dir", lambda _: str(tmp_path))
    for function in (compiled.kernels, compiled._folder, compiled._compiler, compiled._hint):
        function.cache_clear()
    return tmp_path / "functions"


@pytest.fixture
def function() -> ca.Function:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    powers = ca.vertcat(x[0] ** 1.7, ca.sqrt(x[1]), ca.exp(-x[2]), ca.log(x[0]), ca.tanh(y[0]), ca.atan2(y[0], x[1]))
    angles = ca.horzcat(ca.sin(x), ca.cos(x), ca.fabs(x - 1), x * y[1] / x[0])
    return ca.Function("mixed", [x, y], [powers, angles], ["x", "y"], ["powers", "angles"])


def values(function: ca.Function, kernel: compiled.Kernel | None) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return Batch(function, COUNT, kernel)(rng.uniform(0.1, 2.0, (COUNT, 3)), rng.uniform(0.1, 2.0, (COUNT, 2)))


def test_machine_code_gives_the_interpreters_numbers(function: ca.Function, folder: Path) -> None:
    (kernel,) = compiled.kernels((function,))
    assert kernel is not None
    assert [f.suffix for f in sorted(folder.iterdir())] == [".sha256", ".so"]
    for fast, slow in zip(values(function, kernel), values(function, None), strict=True):
        np.testing.assert_allclose(fast, slow, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("damage", ["half", "empty", "link", "wrong digest", "no digest", "digest of no text"])
def test_a_damaged_cache_entry_is_built_again(function: ca.Function, folder: Path, damage: str) -> None:
    compiled.kernels((function,))
    (library,) = folder.glob("*.so")
    content = library.read_bytes()
    library.unlink()  # a loaded library must not change under the process
    if damage == "link":
        (folder.parent / "elsewhere.so").write_bytes(content)
        library.symlink_to(folder.parent / "elsewhere.so")
    elif "digest" in damage:
        (digest,) = folder.glob("*.sha256")
        digest.write_bytes(b"\xff\xfe" if "text" in damage else digest.read_bytes()[::-1])
        library.write_bytes(content)
        if damage == "no digest":
            digest.unlink()
    else:
        library.write_bytes(content[: len(content) // 2] if damage == "half" else b"")
    compiled.kernels.cache_clear()
    (kernel,) = compiled.kernels((function,))
    assert kernel is not None
    assert not library.is_symlink()
    assert library.stat().st_size == len(content)
    np.testing.assert_allclose(values(function, kernel)[0], values(function, None)[0], rtol=1e-14)


@pytest.mark.parametrize("reason", ["others may write", "somebody else's", "no compiler", "a failing compiler"])
def test_fall_back_to_the_interpreter_with_one_hint(
    function: ca.Function, folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, reason: str
) -> None:
    if reason == "others may write":
        folder.mkdir(parents=True)
        folder.chmod(0o777)
    elif reason == "somebody else's":
        monkeypatch.setattr(compiled.os, "getuid", lambda: 12345)
    elif reason == "no compiler":
        monkeypatch.setattr(compiled.shutil, "which", lambda _: None)
    else:
        monkeypatch.setattr(compiled, "FLAGS", (*compiled.FLAGS, "--no-such-flag"))
    with caplog.at_level(logging.WARNING):
        assert [*compiled.kernels((function,)), *compiled.kernels((function,))] == [None, None]
    assert len(caplog.records) == 1
    assert "interpreter" in caplog.text
