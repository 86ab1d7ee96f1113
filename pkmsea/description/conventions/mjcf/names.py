"""MuJoCo's names as those of links and joints: each once, and none empty."""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain, count

import mujoco


def name_of(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """The name of an element; where it has none, its kind or that of the equality, and its number."""
    label = mujoco.mjtEq(model.eq_type[index]) if kind == mujoco.mjtObj.mjOBJ_EQUALITY else kind
    return mujoco.mj_id2name(model, kind, index) or f"{label.name.partition('_')[2].lower()}{index + 1}"


class Names:
    """The links of a URDF are MuJoCo's bodies and its named sites.

    Attributes
    ----------
    bodies, joints : by index.
    sites : by index; those without a name are left out.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        bodies, joints, sites = (
            [mujoco.mj_id2name(model, kind, i) for i in range(size)]
            for kind, size in (
                (mujoco.mjtObj.mjOBJ_BODY, model.nbody),
                (mujoco.mjtObj.mjOBJ_JOINT, model.njnt),
                (mujoco.mjtObj.mjOBJ_SITE, model.nsite),
            )
        )
        self._links, self._joints = set(filter(None, bodies)), set(filter(None, joints))
        self.bodies = [name or self.link(f"body{i}") for i, name in enumerate(bodies)]
        self.joints = [name or self.joint(f"joint{i + 1}") for i, name in enumerate(joints)]
        self.sites = {
            i: self.link(f"{name}_site" if name in self._links else name) for i, name in enumerate(sites) if name
        }

    def link(self, wanted: str) -> str:
        """A new name for a link."""
        self._links.add(name := _fresh(wanted, self._links))
        return name

    def joint(self, wanted: str) -> str:
        """A new name for a joint."""
        self._joints.add(name := _fresh(wanted, self._joints))
        return name

    def frame(self, wanted: str) -> str:
        """A new name for a frame that is neither link nor joint."""
        self._links.add(name := _fresh(wanted, self._links | self._joints))
        return name


def _fresh(wanted: str, taken: Collection[str]) -> str:
    return next(name for name in chain([wanted], (f"{wanted}_{i}" for i in count(2))) if name not in taken)
