"""The tree of a compiled model as URDF: bodies and named sites are links with MuJoCo's frames."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import pinocchio as pin
from lxml import etree
from mujoco import mjtDisableBit, mjtJoint

from pkmsea.description.conventions.mjcf.active import actuators, disabled
from pkmsea.description.conventions.mjcf.compiled import Mesh, pose
from pkmsea.description.conventions.mjcf.drawn import add_visuals
from pkmsea.description.conventions.mjcf.names import Names
from pkmsea.description.xml import Element, origin, text


def to_urdf(model: mujoco.MjModel, names: Names, meshes: Mapping[int, Mesh]) -> Element:
    """Joints have MuJoCo's coordinates, `ref` included; a joint without range is continuous."""
    root = etree.Element("robot", name="mjcf")
    links = [etree.SubElement(root, "link", name=name) for name in names.bodies]
    for body in np.flatnonzero(model.body_treeid >= 0).tolist():  # others are fixed to the world
        placement = pose(model.body_ipos[body], model.body_iquat[body])
        _inertial(links[body], model.body_mass[body], placement, model.body_inertia[body])
    for body in range(1, model.nbody):
        _joints(root, model, names, body)
    for site, name in names.sites.items():
        etree.SubElement(root, "link", name=name)
        parent = names.bodies[model.site_bodyid[site]]
        _fixed(root, names, (parent, name), pose(model.site_pos[site], model.site_quat[site]))
    add_visuals(links, model, meshes)
    return root


def _joints(root: Element, model: mujoco.MjModel, names: Names, body: int) -> None:
    """T(q) = T_body prod_i D(p_i) exp(a_i (q_i - ref_i)) D(-p_i), for axes a_i through the points p_i of the body."""
    parent, link = names.bodies[model.body_parentid[body]], names.bodies[body]
    placement = pose(model.body_pos[body], model.body_quat[body])
    first = model.body_jntadr[body]
    joints = range(first, first + model.body_jntnum[body])
    for i in joints:
        anchor, moved = pose(model.jnt_pos[i]), -model.qpos0[i] * model.jnt_axis[i]
        if model.jnt_type[i] == mjtJoint.mjJNT_SLIDE:
            anchor, reference = pose(), pose(moved)
        else:
            reference = pin.SE3(pin.exp3(moved), np.zeros(3))
        child = link
        if i != joints[-1] or anchor.translation.any():
            child = names.link(f"moved_by_{names.joints[i]}")
            _inertial(etree.SubElement(root, "link", name=child), 0.0, pose(), np.zeros(3))
        _moving(root, model, names, i, (parent, child), placement * anchor * reference)
        parent, placement = child, anchor.inverse()
    if parent != link:
        _fixed(root, names, (parent, link), placement)


def _moving(
    root: Element, model: mujoco.MjModel, names: Names, i: int, links: tuple[str, str], placement: pin.SE3
) -> None:
    off = disabled(model, mjtDisableBit.mjDSBL_CONSTRAINT, mjtDisableBit.mjDSBL_LIMIT)
    limited = model.jnt_limited[i] and not off
    turning = "revolute" if limited else "continuous"
    kind = "prismatic" if model.jnt_type[i] == mjtJoint.mjJNT_SLIDE else turning
    joint = _joint(root, names.joints[i], kind, links, placement)
    etree.SubElement(joint, "axis", xyz=text(model.jnt_axis[i]))
    lower, upper = model.jnt_range[i]
    limits = {"lower": text([lower]), "upper": text([upper])} if limited else {}
    limits |= {"effort": text([model.jnt_actfrcrange[i, 1]])} if model.jnt_actfrclimited[i] else {}
    etree.SubElement(joint, "limit", limits)
    dof = model.jnt_dofadr[i]
    motors = [k for k in actuators(model) if model.actuator_trnid[k, 0] == i]
    dynamics = {
        "damping": model.dof_damping[dof] + model.actuator_damping[motors].sum(),
        "friction": model.dof_frictionloss[dof],
        "armature": model.dof_armature[dof] + model.actuator_armature[motors] @ model.actuator_gear[motors, 0] ** 2,
    }
    if any(dynamics.values()):
        etree.SubElement(joint, "dynamics", {key: text([value]) for key, value in dynamics.items()})


def _fixed(root: Element, names: Names, links: tuple[str, str], placement: pin.SE3) -> None:
    _joint(root, names.joint(f"{links[1]}_fixed"), "fixed", links, placement)


def _joint(root: Element, name: str, kind: str, links: tuple[str, str], placement: pin.SE3) -> Element:
    joint = etree.SubElement(root, "joint", name=name, type=kind)
    for end, link in zip(("parent", "child"), links, strict=True):
        etree.SubElement(joint, end, link=link)
    origin(joint, placement)
    return joint


def _inertial(link: Element, mass: float, placement: pin.SE3, moments: np.ndarray) -> None:
    """Principal `moments` at the centre of mass, along the axes of its placement."""
    R = placement.rotation
    inertia = R @ np.diag(moments) @ R.T
    inertial = etree.SubElement(link, "inertial")
    etree.SubElement(inertial, "origin", xyz=text(placement.translation))
    etree.SubElement(inertial, "mass", value=text([mass]))
    entries = {f"i{'xyz'[r]}{'xyz'[c]}": text([inertia[r, c]]) for r in range(3) for c in range(r, 3)}
    etree.SubElement(inertial, "inertia", entries)
