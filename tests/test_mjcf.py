"""MJCF means what MuJoCo takes it for: M, bias, loops, sites, ranges and gravity equal those of its engine."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from mjcf_models import BULK, MODELS, UNMODELLED
from mujoco import mjtEq, mjtObj

from pkmsea.bridge import frame_id, tree_functions
from pkmsea.description import Description, meshes, read
from pkmsea.errors import MechanismError
from pkmsea.mechanism import closures
from pkmsea.mechanism.model import build_model
from pkmsea.new import new

EQUAL = 1e-9  # asked for; poses go through roll, pitch and yaw
POSES = 5
ROWS = {int(kind): n for kind, n in ((mjtEq.mjEQ_CONNECT, 3), (mjtEq.mjEQ_WELD, 6), (mjtEq.mjEQ_JOINT, 1))}
CASES = Path(__file__).parents[2] / "shared" / "cases"  # beside the checkout, where there are any
FILES = sorted(CASES.glob("mjcf_*/*.xml"))
REFUSED = {
    "coordinate_global": r"global coordinates no longer supported",
    "gravcomp": r"gravcomp of body 'l2'",
    "tendon_armature": r"armature of tendon 'f'",
    "tendon_fixed_spring": r"stiffness of tendon 'f'",
    "tendon_spring": r"stiffness of tendon 'tendon1'",
}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo itself, as the tests call it, may write its log into the working directory."""
    monkeypatch.chdir(tmp_path)


class Engine:
    """MuJoCo's model at one pose, its numbers in pkmsea's order of joints."""

    def __init__(self, file: Path, joints: list[str], locked: dict[str, float]) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.data = mujoco.MjData(self.model)
        assert {self.model.joint(i).name for i in range(self.model.njnt)} == {*joints, *locked}
        self.at = [int(self.model.joint(name).qposadr[0]) for name in joints]
        for name, q in locked.items():
            self.data.joint(name).qpos = q

    def move(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[self.at], self.data.qvel[self.at] = q, v
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self) -> np.ndarray:
        """Of the bodies alone: a rotor's inertia belongs to its drive."""
        M, motors = np.zeros((self.model.nv, self.model.nv)), np.zeros(self.model.nv)
        mujoco.mj_fullM(self.model, self.data, M)
        np.add.at(
            motors, self.model.actuator_trnid[:, 0], self.model.actuator_armature * self.model.actuator_gear[:, 0] ** 2
        )
        return (M - np.diag(self.model.dof_armature + motors))[np.ix_(self.at, self.at)]

    def bias(self) -> np.ndarray:
        return self.data.qfrc_bias[self.at]

    def equalities(self) -> list[tuple[int, np.ndarray]]:
        """Index and rows of each that is active."""
        active = np.flatnonzero(self.data.eq_active)
        ends = np.cumsum([ROWS[int(kind)] for kind in self.model.eq_type[active]])
        assert ends[-1:].sum() == self.data.ne
        return list(zip(active, np.split(self.data.efc_pos[: self.data.ne], ends[:-1]), strict=False))


def assert_equal(ours: np.ndarray, theirs: np.ndarray, what: str) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=EQUAL * max(1.0, np.abs(theirs).max(initial=0)), err_msg=what)


def compare(file: Path) -> Description:
    """Everything at random poses."""
    description = read(file)
    model = build_model(description)
    joints, rng = list(model.names)[1:], np.random.default_rng(0)
    engine = Engine(file, joints, dict(description.locked))
    tree = tree_functions(model, [frame for closure in description.closures for frame in closure.frames])
    q = ca.SX.sym("q", model.nq)
    residual = ca.Function("Phi", [q], [closures.residual(q, tree, description, joints)])
    gravity = engine.model.opt.gravity * (not engine.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    assert_equal(np.array(description.gravity), gravity, "gravity")
    for _ in range(POSES):
        at, v = rng.uniform(-1, 1, (2, model.nq))
        engine.move(at, v)
        assert_equal(np.array(tree.mass_matrix(at)), engine.mass_matrix(), "M")
        assert_equal(np.array(tree.bias(at, v)).ravel(), engine.bias(), "bias")
        compare_sites(model, engine, at)
        compare_residual(np.array(residual(at)).ravel(), engine, description)
    compare_ranges(model, engine, joints)
    return description


def compare_sites(model: pin.Model, engine: Engine, q: np.ndarray) -> None:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    for kind, count, x, R in (
        (mjtObj.mjOBJ_SITE, engine.model.nsite, engine.data.site_xpos, engine.data.site_xmat),
        (mjtObj.mjOBJ_BODY, engine.model.nbody, engine.data.xpos, engine.data.xmat),
    ):
        for i in range(count):
            placement = data.oMf[frame_id(model, mujoco.mj_id2name(engine.model, kind, i))]
            assert_equal(placement.translation, x[i], f"{kind} {i}")
            assert_equal(placement.rotation.ravel(), R[i], f"{kind} {i}")


def compare_residual(Phi: np.ndarray, engine: Engine, description: Description) -> None:
    """Ours are p_2 - p_1 and n sin(angle) of R_1^T R_2, closures first; MuJoCo's p_1 - p_2 and -n sin(angle / 2) s."""
    loops, couplings = [], []
    for i, rows in engine.equalities():
        if engine.model.eq_type[i] == mjtEq.mjEQ_JOINT:
            couplings += [rows] if engine.model.eq_obj2id[i] >= 0 else []
            continue
        start, kind = sum(map(len, loops)), description.closures[len(loops)].type
        turned = rows[3:] / engine.model.eq_data[i, 10] if kind == "frame" else np.zeros(0)
        turned = -2 * turned * np.sqrt(1 - turned @ turned)
        same = np.sign(turned @ Phi[start + 3 : start + 3 + turned.size])  # a quaternion's negative is the same turn
        loops.append(np.append(-rows[:3], same * turned))
    assert (len(loops), len(couplings)) == (len(description.closures), len(description.couplings))
    assert_equal(Phi, np.concatenate([*loops, *couplings, np.zeros(0)]), "loops")


def compare_ranges(model: pin.Model, engine: Engine, joints: list[str]) -> None:
    off = engine.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT
    for i, name in enumerate(joints):
        joint = engine.model.joint(name)
        if joint.limited[0] and not off:
            assert_equal(np.array([model.lowerPositionLimit[i], model.upperPositionLimit[i]]), joint.range, name)
        else:
            assert model.upperPositionLimit[i] >= 10 and model.lowerPositionLimit[i] <= -10


@pytest.mark.parametrize("name", MODELS)
def test_equal_to_mujoco(tmp_path: Path, name: str) -> None:
    (tmp_path / "robot.xml").write_text(MODELS[name])
    compare(tmp_path / "robot.xml")


@pytest.mark.skipif(not FILES, reason=f"{CASES} is not there")
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_cases(file: Path) -> None:
    if file.stem in REFUSED:
        with pytest.raises(MechanismError, match=REFUSED[file.stem]):
            read(file)
    else:
        compare(file)


def test_all_that_is_not_modelled_stands_in_one_message(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(UNMODELLED)
    with pytest.raises(MechanismError, match=r"robot\.xml, mujoco: pkmsea does not model") as caught:
        read(tmp_path)
    for kind, names in {
        "free joint": "'root'",
        "ball joint": "'shoulder'",
        "stiffness of joint": "'elbow', 'bent'",
        "actuatorfrcrange of joint": "'bent'",
        "stiffness of tendon": "'rope'",
        "damping of tendon": "'rope'",
        "limit of tendon": "'rope'",
        "frictionloss of tendon": "'strap'",
        "armature of tendon": "'strap'",
        "tendon equality": "'taut'",
        "joint equality of a higher degree": "'cam'",
        "equality with a mocap body": "'grip'",
        "actuator": "'pull', 'jet'",
        "gravcomp of body": "'base'",
        "plugin of body": "'cable'",
        "flex": "'sheet'",
        "fluid of option": "'density', 'viscosity'",
    }.items():
        assert f"{kind} {names} (" in str(caught.value)
    assert "gone" not in str(caught.value)


def test_drives_seed_and_ranges(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(MODELS["drives"])
    description = read(tmp_path)
    assert description.actuated == ("b", "a") and dict(description.seed or ()) == {"a": 0.3, "b": -0.2}
    assert description.notes == (
        "joint 'a': friction, damping and armature are not read; drives state theirs in the task",
    )
    assert 'effort="4.0"' in description.tree
    (tmp_path / "mechanism.yaml").write_text("locked: {a: 0.1}")
    held = read(tmp_path)
    assert held.actuated == ("b",) and dict(held.seed or ()) == {"b": -0.2}


def test_a_reference_is_the_seed_and_locked_joints_are_none(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(MODELS["several joints with ref"])
    description = read(tmp_path)
    assert dict(description.locked) == {"y": 0.05}
    seed = {"x": 0.3, "t": np.deg2rad(40), "u": np.deg2rad(-20), "w": 0.0}
    assert dict(description.seed or ()) == pytest.approx(seed)


def test_without_mujoco_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    (tmp_path / "robot.xml").write_text(MODELS["drives"])
    with pytest.raises(MechanismError, match=r"Install it: pip install 'pkmsea\[mjcf\]'\.$"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'mass="1.5"',
            'mass="x"',
            r"'inertial', line \d+: MuJoCo does not compile this file .*bad format in attribute",
        ),
        ("<body ", '<body pos="nan 0 0" ', r"joint 'a': origin xyz"),
        ("</worldbody>", '<geom type="mesh" mesh="m"/></worldbody>', r"name '', id 0, line \d+: .*mesh 'm' not found"),
        ('axis="0 1 0"', 'axis="0 0 0"', r"name 'a', id 0.*axis too small"),
        ("<body ", f"<body> {2 * '<plugin/>'} </body> <body ", "body '': plugin: There are two of them"),
        ("<option ", '<include file="nowhere.xml"/> <option ', r"'include', line 1: .*nowhere\.xml"),
    ],
)
def test_a_compile_error_is_mujocos_in_one_message(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, message: str
) -> None:
    assert old in MODELS["drives"]
    (tmp_path / "robot.xml").write_text(MODELS["drives"].replace(old, new, 1))
    with pytest.raises(MechanismError, match=r"robot\.xml, " + message):
        read(tmp_path / "robot.xml")
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == ["robot.xml"]


def tetrahedron(file: Path) -> np.ndarray:
    """Write an STL file; its vertices (4, 3)."""
    vertices = np.array([[0.3, 0.1, 0], [0.5, 0.1, 0], [0.3, 0.4, 0], [0.3, 0.1, 0.7]], dtype=np.float32)
    faces = [
        np.concatenate([np.zeros((1, 3)), vertices[[*face]]]) for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    triangles = b"".join(face.astype("<f4").tobytes() + b"\0\0" for face in faces)
    file.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + triangles)
    return vertices


PLACED = ['scale="1 2 -3"', 'refpos="0.1 0.2 0.3" refquat="0.5 0.5 0.5 0.5" scale="2 2 2"', 'refpos="0.1 0 0"', ""]


def drawn(folder: Path, mesh: str = "", inertial: str = BULK) -> Path:
    """A folder with a link that is drawn by a mesh, a capsule and a hidden box."""
    tetrahedron(folder / "parts" / "a b%.stl")
    (folder / "assets.xml").write_text(f'<mujoco><asset><mesh name="m" file="a b%.stl" {mesh}/></asset></mujoco>')
    (folder / "robot.xml").write_text(f"""<mujoco> <compiler meshdir="parts"/> <include file="assets.xml"/>
      <worldbody> <geom type="plane" size="1 1 1"/> <body name="l"> <joint name="a" axis="0 1 0"/> {inertial}
        <geom type="mesh" mesh="m" pos="1 2 3" euler="10 20 30"/> <geom type="capsule" size="0.1 0.3" euler="0 90 0"/>
        <geom size="9 9 9" type="box" mass="0" group="3"/> <site name="tool" pos="0 0 1"/> </body>
      </worldbody> </mujoco>""")
    return folder / "robot.xml"


@pytest.mark.parametrize("mesh", PLACED)
def test_a_mesh_is_drawn_where_mujoco_has_it(tmp_path: Path, mesh: str) -> None:
    file = drawn(tmp_path, mesh)
    description = read(file)
    mujoco.mj_clearCache(mujoco.mj_getCache())  # else it gives a mesh as the last model has placed it
    model = mujoco.MjModel.from_xml_path(str(file))
    R = pin.Quaternion(*model.geom_quat[1]).matrix()
    theirs = model.mesh_vert @ R.T + model.geom_pos[1]
    root = etree.fromstring(description.tree)
    visual = next(v for v in root.iter("visual") if v.find("geometry/mesh") is not None)
    shape, origin = visual.find("geometry/mesh"), visual.find("origin")
    assert meshes.resolve(shape.get("filename"), tmp_path) == tmp_path / "parts" / "a b%.stl"
    rpy, xyz, scale = (
        np.array(text.split(), float) for text in (origin.get("rpy"), origin.get("xyz"), shape.get("scale"))
    )
    ours = (scale * tetrahedron(tmp_path / "again.stl")) @ pin.rpy.rpyToMatrix(rpy).T + xyz
    gaps = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
    assert gaps.min(axis=1).max() < 1e-6  # vertices are single precision
    kinds = [v.find("geometry")[0].tag for v in root.iter("visual")]
    assert kinds == ["mesh", "cylinder", "sphere", "sphere"]


def test_a_mesh_weighs_the_same_whatever_was_read_before(tmp_path: Path) -> None:
    """MuJoCo 3.10 caches the vertices of a file as the last model has placed them."""
    centres = []
    for mesh in ("", 'refpos="0.1 0 0"', ""):
        centres.append(build_model(read(drawn(tmp_path / "robot", mesh, inertial=""))).inertias[1].lever)
    assert_equal(centres[0], centres[2], "the same file")
    assert np.linalg.norm(centres[0] - centres[1]) > 0.01


def test_new_takes_all_that_the_model_names(tmp_path: Path) -> None:
    file = drawn(tmp_path / "there")
    new(tmp_path / "here", file)
    here, there = read(tmp_path / "here" / "robot.xml"), read(file)
    assert (here.tree, here.frames) == (there.tree, there.frames) and "<mesh" in here.tree
    names = {str(path.relative_to(tmp_path / "here")) for path in (tmp_path / "here").rglob("*") if path.is_file()}
    assert names == {"robot.xml", "assets.xml", "parts/a b%.stl", "mechanism.yaml", "task.yaml"}
