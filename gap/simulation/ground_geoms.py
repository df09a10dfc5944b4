"""What a robot that floats stands on.

ground = Ground(model)
ground.fixed, ground.moving, ground.pairs      # ids of geoms, and of explicit pairs of them
if not ground:
    note = add_floor(spec)
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

_FLOOR = "ground"


class Ground:
    """Which geoms of a model can touch what does not move.

    Args:
        model: the model.

    Attributes:
        fixed: ids of geoms of the world that a moving geom can touch; none of what a robot is
            mounted by, as the trunk of one that hangs, unless it is a plane.
        moving: ids of moving geoms that can touch one of those.
        contacts: (n, 2) which of the first can touch which of the second.
        pairs: ids of the explicit contact pairs between such geoms.
    """

    def __init__(self, model: mujoco.MjModel):
        still = model.body_weldid[model.geom_bodyid] == 0
        kinds, partners = model.geom_contype, model.geom_conaffinity
        touch = (kinds[:, None] & partners[None]) | (kinds[None] & partners[:, None]) != 0
        mounts = np.isin(model.body_rootid, model.body_rootid[model.body_weldid != 0])
        mounts[0] = False
        planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        scenery = still & (planes | ~mounts[model.geom_bodyid])
        touch &= scenery[:, None] & ~still[None]
        for signature in model.exclude_signature:
            first, second = signature >> 16, signature & 0xFFFF
            for one, other in ((first, second), (second, first)):
                touch[np.ix_(model.geom_bodyid == one, model.geom_bodyid == other)] = False
        paired = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
        across = (scenery[paired] & ~still[paired[:, ::-1]]).any(axis=1)
        for first, second in paired[across]:
            # Explicit pairs take the place of what the geoms themselves say.
            touch[first, second] = touch[second, first] = False
        self.contacts: NDArray[np.intp] = np.argwhere(touch)
        self.fixed: NDArray[np.intp] = np.flatnonzero(touch.any(axis=1))
        self.moving: NDArray[np.intp] = np.flatnonzero(touch.any(axis=0))
        self.pairs: NDArray[np.intp] = np.flatnonzero(across)

    def __bool__(self) -> bool:
        return bool(self.fixed.size or self.pairs.size)

    @property
    def geoms(self) -> NDArray[np.intp]:
        """Both sides of its contacts, explicit pairs left out."""
        return np.concatenate([self.fixed, self.moving])


def add_floor(spec: mujoco.MjSpec) -> str:
    """Puts a level floor at height 0 under a robot that has nothing to stand on.

    Args:
        spec: the robot, written to.

    Returns:
        What a user should know of it.
    """
    taken = {geom.name for geom in spec.geoms}
    name = next(n for n in (_FLOOR, *(f"{_FLOOR}_{k}" for k in range(2, 99))) if n not in taken)
    spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    return (
        "The robot floats and its model has nothing to stand on, so a level floor at height 0 was "
        f"added, the geom {name!r}. Give a model with its ground if that is another."
    )
