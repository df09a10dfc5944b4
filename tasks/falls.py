"""When a walker has fallen, and how it is put on its feet.

It has fallen when its root body is tilted too far from the pose of the episode's start, is too low
against its height there, or when something other than the links that carry its end effectors
touches the ground: a shin that ends in a foot may, the knee above it may not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.tasks.trunk import Trunk

_FAR = 10.0  # m; what is farther from the ground than this is left in the air


@dataclass(frozen=True, kw_only=True)
class FallLimits:
    """What counts as a fall.

    Attributes:
        tilt: the largest angle from upright [rad]; π for any.
        height: the least height of the root body, as a share of that at the start; 0 for any.
        contact: whether a touch of the ground with anything but the links of its end effectors is.

    Raises:
        ValueError: a number is out of its bounds.
    """

    tilt: float = 1.0
    height: float = 0.5
    contact: bool = True

    def __post_init__(self) -> None:
        for name, highest in (("tilt", math.pi), ("height", 1.0)):
            value = getattr(self, name)
            if not 0 <= value <= highest:
                raise ValueError(f"{name} is {value}; it should be from 0 to {highest:g}")


STANDING = FallLimits()
"""The limits of a robot that walks on its feet."""


class Ground:
    """What a walker has to do with the ground.

    Args:
        walker: a composer walker with `ground_contact_geoms`, as legged ones have.
        arena: with `ground_geoms`.
    """

    def __init__(self, walker: Any, arena: Any):
        self._walker = walker
        self._arena = arena
        self._body: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._ground: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._pairs: list[tuple[int, int]] = []

    def after_compile(self, physics: Any) -> None:
        """Finds the geoms in the compiled model."""
        model = physics.model
        walker = self._walker
        own = walker.mjcf_model.find_all("geom")
        ids = np.array([int(physics.bind(geom).element_id) for geom in own], dtype=np.intp)
        # A foot without a joint of its own is one with its shin.
        link = model.body_weldid[model.geom_bodyid]
        feet = {int(link[physics.bind(geom).element_id]) for geom in walker.ground_contact_geoms}
        ground = [int(physics.bind(geom).element_id) for geom in self._arena.ground_geoms]
        self._body = np.zeros(model.ngeom, dtype=bool)
        self._body[[i for i in ids if int(link[i]) not in feet]] = True
        self._ground = np.zeros(model.ngeom, dtype=bool)
        self._ground[ground] = True
        self._pairs = [(int(a), b) for a in ids for b in ground if _collide(model, a, b)]

    @property
    def watched(self) -> list[tuple[int, int]]:
        """Pairs of geoms, of the walker and of the ground, that must not touch."""
        return [(own, ground) for own, ground in self._pairs if self._body[own]]

    def touched(self, physics: Any) -> bool:
        """Something other than the link of an end effector touches the ground."""
        geom = physics.data.contact.geom
        if not len(geom):
            return False
        first, second = geom.T
        return bool(
            np.any(
                (self._body[first] & self._ground[second])
                | (self._ground[first] & self._body[second])
            )
        )

    def clearance(self, physics: Any) -> float:
        """Distance from the walker to the ground, negative inside it [m]; 0 where it is unknown.

        Args:
            physics: with geom poses that are up to date.
        """
        model, data = physics.model.ptr, physics.data.ptr
        nearest = min(
            (mujoco.mj_geomDistance(model, data, a, b, _FAR, None) for a, b in self._pairs),
            default=_FAR,
        )
        return float(nearest) if nearest < _FAR else 0.0


class FallDetector:
    """Tells whether a walker has fallen.

    Args:
        limits: what counts as a fall.
        trunk: of the walker.
        ground: of the walker.
    """

    def __init__(self, limits: FallLimits, trunk: Trunk, ground: Ground):
        self.limits = limits
        self._least_cos = math.cos(limits.tilt)
        self._trunk = trunk
        self._ground = ground

    def reasons(self, physics: Any) -> Sequence[str]:
        """Why it counts as fallen, of `tilt`, `height` and `contact`; empty while it stands."""
        found = []
        if self._trunk.cos_tilt(physics) < self._least_cos:
            found.append("tilt")
        if self._trunk.height(physics) < self.limits.height * self._trunk.home_height:
            found.append("height")
        if self.limits.contact and self._ground.touched(physics):
            found.append("contact")
        return found


def _collide(model: Any, first: int, second: int) -> bool:
    types = model.geom_type[[first, second]]
    if types[0] == mujoco.mjtGeom.mjGEOM_PLANE or types[1] == mujoco.mjtGeom.mjGEOM_HFIELD:
        return False
    return bool(
        model.geom_contype[first] & model.geom_conaffinity[second]
        or model.geom_contype[second] & model.geom_conaffinity[first]
    )
