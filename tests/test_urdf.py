"""What a URDF says beyond its tree is read, noted, or refused by name; nothing of it vanishes."""

from __future__ import annotations

import re
from pathlib import Path

import five_bar
import numpy as np
import pinocchio as pin
import pytest
from linkage import ends, four_bar, tree

from pkmsea.description import read
from pkmsea.errors import InputError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.new import new
from pkmsea.task import load_task

EQUAL = 1e-9  # relative; the same numbers by another way
LOOP = {"plane": None, "frames": {}, "closures": None, "end_effector": {"frame": "l2", "axes": ["x"]}}
DRAKE = 'name="four_bar" xmlns:drake="http://drake.mit.edu"'
JOINT = '<gazebo><joint name="pin" type="{}"><parent>l2</parent><child>l3</child>{}</joint></gazebo>'
AXIS = "<axis><xyz>0 0 1</xyz></axis>"
ARM = (
    '<robot name="arm"><link name="base"/><link name="a"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>'
    '<inertia ixx="1e-3" iyy="1e-2" izz="1.1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="b"><inertial>'
    '<mass value="0.5"/><origin xyz="0.1 0 0"/><inertia ixx="1e-3" iyy="1e-2" izz="1.1e-2" ixy="0" ixz="0" iyz="0"/>'
    '</inertial></link><link name="tip"/>'
    '<joint name="A" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="10" velocity="5"/></joint>'
    '<joint name="B" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="10" velocity="5"/></joint>'
    '<joint name="T" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>'
)


@pytest.fixture(scope="module")
def native(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    folder = four_bar(tmp_path_factory.mktemp("urdf") / "native", end_effector={"frame": "l2", "axes": ["x"]})
    return load_mechanism(folder)


def closed(folder: Path, more: str, **keys: object) -> Mechanism:
    """The four-bar whose loop stands in its tree alone."""
    text = tree(more=more).replace('name="four_bar"', DRAKE)
    return load_mechanism(four_bar(folder, text, **(LOOP | keys)))


def edited(folder: Path, *pairs: tuple[str, str], keys: dict | None = None) -> Path:
    """The arm with texts of its URDF replaced, each once."""
    text = ARM
    for old, new_ in pairs:
        assert old in text, old
        text = text.replace(old, new_, 1)
    return five_bar.write(folder, "arm.urdf", text, keys)


def notes(folder: Path) -> str:
    """Those of a mechanism, or of the error that it ends in."""
    try:
        return "\n".join(load_mechanism(folder, guess=True).description.notes)
    except InputError as error:
        return "\n".join(error.notes)


@pytest.mark.parametrize(
    ("more", "note"),
    [
        ('<constraint name="pin" type="spherical_joint"><parent link="l2"/><parent_origin xyz="0.2 0 0"/>'
         '<child link="l3"/><child_origin xyz="0.16 0 0"/></constraint>', ""),
        ('<constraint name="pin" type="revolute"><parent link="l2"/><parent_origin xyz="0.2 0 0"/><child link="l3"/>'
         '<child_origin xyz="0.16 0 0"/></constraint>', "loop 'pin': its axis is not stated"),
        ('<loop_joint name="pin" type="continuous"><link1 link="l2" xyz="0.2 0 0"/><link2 link="l3" xyz="0.16 0 0"/>'
         '<axis xyz="0 0 1"/></loop_joint>', ""),
        ('<loop_joint name="pin" type="revolute"><link1 link="l2" xyz="0.2 0 0"/><link2 link="l3" xyz="0.16 0 0"/>'
         "</loop_joint>", "its axis is not stated"),
        ('<drake:ball_constraint><drake:ball_constraint_body_A name="l2"/><drake:ball_constraint_p_AP value="0.2 0 0"/>'
         '<drake:ball_constraint_body_B name="l3"/><drake:ball_constraint_p_BQ value="0.16 0 0"/>'
         "</drake:ball_constraint>", ""),
    ],
)  # fmt: skip
def test_loops_of_other_programs(native: Mechanism, tmp_path: Path, more: str, note: str) -> None:
    """Mobility 1 and the mass matrix of the same four-bar with closures of our own."""
    mechanism = closed(tmp_path / "robot", more)
    assert mechanism.mobility == 1 and len(mechanism.description.closures) == 1
    assert any(note in line for line in mechanism.description.notes) or not note
    q = mechanism.configuration([0.02])
    np.testing.assert_allclose(mechanism.mass_matrix(q), native.mass_matrix(native.configuration([0.02])), rtol=1e-6)


@pytest.mark.parametrize(
    "inside",
    [
        f"<pose>0.16 0 0 0 0 0</pose>{AXIS}",
        f'<pose relative_to="l3">0.16 0 0 0 0 0.7</pose>{AXIS}',
        f'<pose frame="l3">0.16 0 0 0 0 0</pose>{AXIS}',
        '<pose>0.16 0 0 0 0 0</pose><axis><xyz expressed_in="__model__">0 -1 0</xyz></axis>',
        "<pose>0.16 0 0 0.3 0 0</pose><axis><xyz>0 -1 0</xyz><use_parent_model_frame>1</use_parent_model_frame></axis>",
        f'<pose relative_to="__model__">0.36 0 0 1.5707963267948966 0 0</pose>{AXIS}',
    ],
)
def test_gazebo_joints_close_where_the_tree_stands_at_zero(tmp_path: Path, inside: str) -> None:
    """At zero the rocker ends at x = 0.36 m, which lies 0.26 m along the coupler: SDF makes it 0.26 m long."""
    seed = {"j1": 1.2, "j2": -0.9, "j3": 1.5}
    mechanism = closed(tmp_path / "robot", JOINT.format("revolute", inside), seed=seed)
    assert mechanism.mobility == 1 and mechanism.description.closures[0].type == "revolute"
    keys = {"frames": ends() | {"e2": {"link": "l2", "xyz": [0.26, 0, 0]}}, "seed": seed}
    reference = load_mechanism(four_bar(tmp_path / "own", end_effector={"frame": "l2", "axes": ["x"]}, **keys))
    np.testing.assert_allclose(mechanism.seed, reference.seed, atol=1e-6)
    np.testing.assert_allclose(mechanism.mass_matrix(mechanism.seed), reference.mass_matrix(reference.seed), rtol=1e-5)


def test_a_base_that_gazebo_fixes_to_the_world_is_no_loop(native: Mechanism, tmp_path: Path) -> None:
    fixed = '<gazebo><joint name="w" type="fixed"><parent>world</parent><child>base</child></joint></gazebo>'
    folder = four_bar(tmp_path / "robot", tree(more=fixed))
    assert [closure.frames for closure in load_mechanism(folder).description.closures] == [("e2", "e3")]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("<wing/>", "robot 'four_bar': wing: <wing> in <robot> is not known.*<loop_joint>"),
        ("<drake:linear_bushing_rpy/>", "robot 'four_bar': drake:linear_bushing_rpy: .* is not known"),
        ('<constraint name="c" type="prismatic"/>', "constraint 'c': type = 'prismatic'.*Open the loop at a pin"),
        ('<constraint name="c" type="revolute"><parent link="l2"/><child link="l9"/></constraint>',
         "constraint 'c': child: There is no link named 'l9'"),
        ('<constraint name="c" type="revolute"><parent link="l2"/><parent_axis xyz="0 0 1"/><child link="l3"/>'
         '<child_axis xyz="0 1 1"/></constraint>', "constraint 'c': child_axis.*axes of parent and child differ"),
        ('<loop_joint name="c" type="spherical"><link1 link="l2"/></loop_joint>', "loop_joint 'c': .*two ends, not 1"),
        ('<loop_joint name="c" type="fixed"><link1 link="l2"/><link2 link="l3"/></loop_joint>' * 2,
         "c_1: Two loops give a frame this name|c_2: Two loops"),
        ("<drake:ball_constraint/>", "drake:ball_constraint 1: <drake:ball_constraint_body_A> is missing"),
        ('<gazebo><link name="more"/></gazebo>', "gazebo: link: A body that Gazebo adds is not read"),
        ('<gazebo reference="j1"><springStiffness>3</springStiffness></gazebo>',
         "gazebo 'j1': springStiffness: A spring at a joint is not read"),
        ('<gazebo><plugin name="p" filename="libgazebo_closed_loop_plugin.so"/></gazebo>',
         "gazebo: plugin: A plugin that joins links"),
        (JOINT.format("prismatic", AXIS), "gazebo joint 'pin': type = 'prismatic'"),
        (JOINT.format("revolute", f'<pose degrees="true">0.1 0 0 0 0 9</pose>{AXIS}'), "gazebo joint 'pin': pose"),
        (JOINT.format("revolute", f'<pose relative_to="x">0.1 0 0 0 0 9</pose>{AXIS}'), "no link named 'x'"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_refused_by_name(tmp_path: Path, more: str, message: str) -> None:
    with pytest.raises(InputError, match=r"(?s)four_bar\.urdf, .*(" + message + ")"):
        closed(tmp_path / "robot", more)


@pytest.mark.parametrize(
    "more",
    [
        '<gazebo reference="l1"><mu1>1</mu1><selfCollide>0</selfCollide></gazebo><gazebo><static>0</static></gazebo>',
        '<sensor name="s"><parent link="l1"/></sensor><material name="grey"/>',
        '<ros2_control name="c" type="system"><joint name="j1"/><hardware/></ros2_control>',
        '<fixed_frame name="f"><parent link="l1"/></fixed_frame><drake:collision_filter_group name="g"/>',
    ],
)
def test_what_changes_no_motion_is_left_out(native: Mechanism, tmp_path: Path, more: str) -> None:
    mechanism = load_mechanism(four_bar(tmp_path / "robot", tree(more=more).replace('name="four_bar"', DRAKE)))
    np.testing.assert_array_equal(mechanism.mass_matrix(native.seed), native.mass_matrix(native.seed))


MIMIC = '<mimic joint="A" multiplier="-2" offset="0.1"/>'
PARAMETERS = (
    '<ros2_control name="c"><joint name="B"><param name="mimic">A</param><param name="multiplier">-2</param>'
    '<param name="offset">0.1</param></joint></ros2_control>'
)
PLUGIN = (
    '<gazebo><plugin name="m" filename="libroboticsgroup_gazebo_mimic_joint_plugin.so"><joint>A</joint>'
    "<mimicJoint>B</mimicJoint><multiplier>-2</multiplier><offset>0.1</offset></plugin></gazebo>"
)


@pytest.mark.parametrize("more", [PARAMETERS, PLUGIN, PLUGIN + PARAMETERS])
def test_couplings_that_simulators_know(tmp_path: Path, more: str) -> None:
    (coupling,) = read(edited(tmp_path / "robot", ("</robot>", f"{more}</robot>")) / "arm.urdf").couplings
    assert (coupling.joint, coupling.of, coupling.ratio, coupling.offset) == ("B", "A", -2, 0.1)


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ([], ["B = -2 A +0.1"]),
        ([{"joint": "B", "of": "A", "ratio": 3}], ["B = 3 A"]),
        ([{"joint": "A", "of": "B", "ratio": 3}], ["A = 3 B"]),
    ],
)
def test_own_couplings_join_those_of_the_tree(tmp_path: Path, own: list, expected: list[str]) -> None:
    """Unless they are of the same joint."""
    mimic = ('<parent link="a"/>', f'{MIMIC}<parent link="a"/>')
    keys = {"couplings": own, "gravity": [0, 0, -9.81]}
    assert [c.label for c in read(edited(tmp_path / "robot", mimic, keys=keys)).couplings] == expected


def test_two_couplings_leave_one_coordinate(tmp_path: Path) -> None:
    """b = -a of the tree and c = 2 a of the sidecar."""
    third = ARM.replace("</robot>", (
        '<link name="c"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="C" type="continuous"><parent link="tip"/><child link="c"/><axis xyz="0 1 0"/>'
        "</joint></robot>"
    )).replace('<parent link="a"/>', '<mimic joint="A" multiplier="-1"/><parent link="a"/>')  # fmt: skip
    keys = {"couplings": [{"joint": "C", "of": "A", "ratio": 2}]}
    mechanism = load_mechanism(five_bar.write(tmp_path / "robot", "arm.urdf", third, keys), guess=True)
    assert mechanism.mobility == 1
    rates = mechanism.velocity_map(mechanism.seed).ravel()
    np.testing.assert_allclose(rates / rates[0], [1, -1, 2], rtol=EQUAL)


@pytest.mark.parametrize(
    ("locked", "held"), [({"A": 0.3}, {"A": 0.3, "B": -0.5}), ({"B": -0.5}, {"A": 0.3, "B": -0.5})]
)
def test_a_locked_joint_holds_its_followers(tmp_path: Path, locked: dict, held: dict) -> None:
    mimic = ('<parent link="a"/>', f'{MIMIC}<parent link="a"/>')
    description = read(edited(tmp_path / "robot", mimic, keys={"locked": locked}))
    assert dict(description.locked) == pytest.approx(held) and not description.couplings
    assert any("since its coupling" in note for note in description.notes)


def test_joints_that_are_locked_against_their_coupling_are_refused(tmp_path: Path) -> None:
    mimic = ('<parent link="a"/>', f'{MIMIC}<parent link="a"/>')
    with pytest.raises(
        InputError, match=r"mechanism\.yaml, locked = 0.2: The coupling B = -2 A \+0.1 .* asks for -0.5"
    ):
        read(edited(tmp_path / "robot", mimic, keys={"locked": {"A": 0.3, "B": 0.2}}))


@pytest.mark.parametrize("version", ["", ' version="1.1"'])
def test_quaternions_survive_locking(tmp_path: Path, version: str) -> None:
    """Against Pinocchio's own reduced model of the same file, which reads quaternions of version 1.1."""
    turned = ('<origin xyz="0.3 0 0"/><axis', '<origin xyz="0.3 0 0" quat_xyzw="0.6 0 0 0.8"/><axis')
    text = ARM.replace(*turned, 1)
    full = pin.buildModelFromXML(text.replace('name="arm"', 'name="arm" version="1.1"'))
    reduced = pin.buildReducedModel(full, [full.getJointId("B")], np.array([0.0, 0.4]))
    keys = {
        "locked": {"B": 0.4},
        "actuated": ["A"],
        "end_effector": {"frame": "tip", "axes": ["z"]},
        "seed": {"A": 0.2},
    }
    mechanism = load_mechanism(edited(tmp_path / "robot", turned, ('name="arm"', f'name="arm"{version}'), keys=keys))
    expected = pin.crba(reduced, reduced.createData(), np.array([0.2]))
    np.testing.assert_allclose(mechanism.mass_matrix(np.array([0.2])), expected, rtol=EQUAL)
    assert "quat_xyzw" not in mechanism.description.tree


@pytest.mark.parametrize(
    ("old", "new_", "note"),
    [
        ('xyz="0.3 0 0"/><axis', 'xyz="0.3 0 0" rpy="0 0 90"/><axis', "joint 'B': rpy = 0 0 90 is more than a turn"),
        ('lower="-2" upper="2"', 'lower="-90" upper="90"', "joint 'A': limits -90 to 90 are many turns"),
        ('mass value="0.5"', 'mass value="500"', "link 'b': its radius of gyration is 0.0047 m, and it is 0.3 m long"),
        ('xyz="0 0 0.1"', 'xyz="0 0 100"', "joint 'A': its origin is 100 m away; .*mm"),
        ("<inertial>", "<gravity>0</gravity><inertial>", "link 'a': its gravity is switched off"),
        ("<inertial>", '<visual><geometry><capsule radius="0.1" length="1"/></geometry></visual><inertial>',
         "link 'a': <capsule> is not drawn"),
        ("</robot>", '<transmission name="t"><joint name="A"/><actuator name="m"><mechanicalReduction>-50'
         "</mechanicalReduction></actuator></transmission></robot>", "gears of transmissions.*'A' -50:1"),
    ],
)  # fmt: skip
def test_noted(tmp_path: Path, old: str, new_: str, note: str) -> None:
    assert notes(edited(tmp_path / "plain")) == ""
    assert re.search(note, notes(edited(tmp_path / "robot", (old, new_)))), note


def test_notes_are_told_with_an_error(tmp_path: Path) -> None:
    """Lengths in mm leave no end effector; why, stands in the notes."""
    folder = edited(tmp_path / "robot", ('xyz="0.3 0 0"/><axis', 'xyz="300 0 0"/><axis'))
    with pytest.raises(InputError, match="No frame follows the motion well") as caught:
        load_mechanism(folder, guess=True)
    assert any("are these mm" in note for note in caught.value.notes)


@pytest.mark.parametrize(
    ("old", "new_", "message"),
    [
        ('<axis xyz="0 1 0"/>', "<axis/>", "joint 'A': axis xyz = ''"),
        ('mass value="0.5"', 'mass value="0"', "link 'b': mass = 0.0: The mass is zero, the inertia is not"),
        ('<link name="tip"/>', '<link name="tip"><origin xyz="0 0 1"/></link>', "link 'tip': origin.*no origin of"),
        ('<origin xyz="0.3 0 0"/><axis', '<origin rpy="0 0 1" quat_xyzw="0 0 0 1"/><axis', "joint 'B': origin: .*both"),
    ],
)  # fmt: skip
def test_refused_with_the_reason(tmp_path: Path, old: str, new_: str, message: str) -> None:
    with pytest.raises(InputError, match=r"arm\.urdf, " + message):
        load_mechanism(edited(tmp_path / "robot", (old, new_)), guess=True)


@pytest.mark.parametrize(
    ("old", "new_"),
    [
        ('<robot name="arm">', "<robot>"),
        ('<link name="tip"/>', '<link name="tip"><origin xyz="0 0 0" rpy="0 0 0"/><inertial><mass value="1e-9"/>'
         '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>'),
        ('<joint name="T" type="fixed">', '<joint name="T" type="fixed"><axis xyz="0 0 0"/><joint_properties/>'),
    ],
)  # fmt: skip
def test_what_exporters_write(tmp_path: Path, old: str, new_: str) -> None:
    """No name; frames of onshape-to-robot, which are links with an origin, on a joint with an axis of zero."""
    ours, plain = (load_mechanism(edited(tmp_path / name, *pairs), guess=True)
                   for name, pairs in (("ours", [(old, new_)]), ("plain", [])))  # fmt: skip
    np.testing.assert_allclose(ours.mass_matrix(plain.seed), plain.mass_matrix(plain.seed), rtol=1e-8)


@pytest.mark.parametrize("kind", ["SPHERICAL", "CARDAN"])
def test_gepettos_balls_do_not_become_hinges(tmp_path: Path, kind: str) -> None:
    folder = four_bar(tmp_path / "robot")
    (folder / "mechanism.yaml").unlink()
    text = f"closed_loop: [[l2, l3]]\nname_mot: [j1]\njoint_name: [j2]\njoint_type: [{kind}]\n"
    (folder / "robot.yaml").write_text(text)
    with pytest.raises(InputError, match=rf"joint_type\.0 = '{kind}': The joint 'j2' .* another mechanism"):
        read(folder)
    (folder / "robot.yaml").write_text(text.replace(kind, "FIXED"))
    assert dict(read(folder).locked) == {"j2": 0.0}


def test_ends_that_meet_are_named_as_a_loop(tmp_path: Path) -> None:
    """At zero, coupler and rocker end 0.3 mm apart, in layers."""
    tips = "".join(
        f'<link name="{name}"/><joint name="{name}_fix" type="fixed"><parent link="{link}"/><child link="{name}"/>'
        f'<origin xyz="{at} 0 0"/></joint>'
        for name, link, at in (("tip_2", "l2", 0.26), ("tip_3", "l3", 0.16))
    )
    folder = four_bar(tmp_path / "robot", tree(layer=3e-4, more=tips), closures=None, plane=None)
    (folder / "mechanism.yaml").unlink()
    assert "'tip_2' and 'tip_3' are 0.3 mm apart" in notes(folder)
    (folder / "mechanism.yaml").write_text("closures: [{frames: [tip_2, tip_3]}]\nplane: {normal: [0, 1, 0]}\n")
    assert "apart" not in notes(folder)


def test_gravity_that_does_no_work_is_told(tmp_path: Path) -> None:
    for gravity, told in (([0, -9.81, 0], True), ([0, 0, -9.81], False), ([0, 0, 0], False)):
        found = notes(four_bar(tmp_path / str(gravity), gravity=gravity))
        assert ("does no work in any motion" in found) == told


def test_a_seed_outside_limits_is_told_and_does_not_end_the_workspace(tmp_path: Path) -> None:
    from pkmsea.views.tables import mechanism_record

    keys = {"actuated": ["A", "B"], "end_effector": {"frame": "tip", "axes": ["x", "z"]}, "seed": {"A": 0.2, "B": 2.5}}
    mechanism = load_mechanism(edited(tmp_path / "robot", keys=keys))
    assert any("joint 'B' stands at 2.5, outside its limits of -2 to 2" in n for n in mechanism.description.notes)
    low, high = mechanism_record(mechanism)["workspace"]["x"]
    assert high - low > 0.1


def test_new_offers_gears_and_rotors(tmp_path: Path) -> None:
    gear = (
        '<transmission name="t"><joint name="A"/><actuator name="m"><mechanicalReduction>50</mechanicalReduction>'
        '<rotor_inertia value="2e-5"/></actuator></transmission></robot>'
    )
    keys = {"actuated": ["A", "B"], "end_effector": {"frame": "tip", "axes": ["x", "z"]}, "seed": {"A": 0.3, "B": 1.0}}
    new(edited(tmp_path / "robot", ("</robot>", gear), keys=keys), None)
    drives = load_task(tmp_path / "robot" / "task.yaml").setups[0].drives
    assert (drives[0].gear_ratio, drives[0].inertia) == (50, 2e-5)
    assert drives[1].gear_ratio is None
