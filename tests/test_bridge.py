"""The bridge's Functions equal Pinocchio's own doubles, on random trees of revolute and prismatic joints."""

import shutil
import subprocess
import sys
import threading
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from pkmsea import bridge
from pkmsea.description import find
from pkmsea.errors import BridgeError, NameNotFound

ROUNDING = 1e-12  # a few hundred operations on numbers of order one


def random_tree(seed: int, joints: int = 6) -> pin.Model:
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.gravity.linear = rng.normal(size=3)
    axes = [pin.JointModelRX(), pin.JointModelRZ(), pin.JointModelPY(), pin.JointModelPZ()]
    joint = 0
    for i in range(joints):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        free = [pin.JointModelRevoluteUnaligned(axis), pin.JointModelPrismaticUnaligned(axis)]
        # depth first, as Pinocchio's own parsers number their joints
        parent = int(rng.choice([0, *model.supports[joint]])) if i else 0
        joint = model.addJoint(parent, rng.choice(axes + free), pin.SE3.Random(), f"joint{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", joint, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return model


@pytest.mark.parametrize("seed", range(5))
def test_functions_equal_pinocchio(seed: int) -> None:
    pin.seed(seed)
    model = random_tree(seed)
    tree, data = bridge.tree_functions(model, ["tip"]), model.createData()
    q, v, a = np.random.default_rng(seed + 100).normal(size=(3, model.nq))
    tip = model.getFrameId("tip")
    pin.framesForwardKinematics(model, data, q)
    upper = np.triu(pin.crba(model, model.createData(), q))
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pairs = [
        (tree.placement["tip"](q), data.oMf[tip].homogeneous),
        (tree.mass_matrix(q), upper + np.triu(upper, 1).T),
        (tree.inverse_dynamics(q, v, a), pin.rnea(model, data, q, v, a).reshape(-1, 1)),
        (tree.bias(q, v), pin.nonLinearEffects(model, data, q, v).reshape(-1, 1)),
        (tree.jacobian["tip"](q), pin.computeFrameJacobian(model, model.createData(), q, tip, world)),
    ]
    for ours, pins in pairs:
        np.testing.assert_allclose(np.array(ours), pins, rtol=0, atol=ROUNDING * max(1, np.abs(pins).max()))


def test_unsupported_joint_is_named() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(BridgeError, match=r"'ball' is of type JointModelSpherical.*revolute and prismatic"):
        bridge.tree_functions(model, [])


def test_unknown_frame_lists_the_known_ones() -> None:
    with pytest.raises(NameNotFound, match=r"Use one of: .*tip"):
        bridge.tree_functions(random_tree(0), ["top"])


def test_compiled_for_another_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib

    monkeypatch.setattr(bridge._bridge, "casadi_version", "3.6.0")
    with pytest.raises(BridgeError, match=r"compiled for casadi 3\.6\.0.*pip install casadi==3\.6\.0"):
        importlib.reload(bridge)


def test_warnings_are_muted_in_one_thread(capfd: pytest.CaptureFixture[str]) -> None:
    """IPOPT meets the logarithm of a negative number, in a thread that is muted and in one that is not."""
    x = ca.SX.sym("x")
    quiet = {"ipopt": {"print_level": 0, "sb": "yes"}, "print_time": False, "error_on_fail": False}
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": -x + ca.log(1 - x) * x}, quiet)
    bridge._bridge.mute(True)
    try:
        solver(x0=0.9)
        assert "".join(capfd.readouterr()) == ""
        other = threading.Thread(target=solver, kwargs={"x0": 0.9})
        other.start()
        other.join()
        assert "NaN detected" in capfd.readouterr().err
    finally:
        bridge._bridge.mute(False)


def test_sources_without_the_compiled_module_use_the_installed_one(tmp_path: Path) -> None:
    """As in a checkout, whose sources hide the installed package: they run, and not the installed ones."""
    sources = shutil.copytree(
        Path(bridge.__file__).parents[1], tmp_path / "pkmsea", ignore=shutil.ignore_patterns("_bridge.*", "__pycache__")
    )
    lines = f"import pkmsea; print(pkmsea.__file__, pkmsea.load_mechanism({str(find('pkm_2rrr'))!r}).mobility)"
    ended = subprocess.run([sys.executable, "-c", lines], cwd=tmp_path, capture_output=True, text=True)
    assert ended.stdout.split() == [str(sources / "__init__.py"), "2"], ended.stderr
