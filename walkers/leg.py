"""One quadruped-class leg hung from a fixed base: the smallest robot worth diagnosing.

    from dm_control import composer
    from walkerkit.walkers import LEG_XML, Leg

    environment = composer.Environment(composer.NullTask(Leg()))
    environment.reset()
    environment.step(environment.action_spec().minimum)

Three hinges, `hip` (abduction), `thigh` and `calf`, each under a position servo of the same name.
The leg touches nothing, so that joint logs speak of the drives alone. `LEG_XML` is the same robot
as a plain MJCF file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_control.locomotion.walkers import base
from numpy.typing import NDArray

LEG_XML: Final = Path(__file__).parent / "assets" / "leg.xml"
"""Path of the leg's plain MJCF."""


class LegObservables(base.WalkerObservables):  # type: ignore[misc]
    """What the leg's encoders and the base's inertial unit read."""

    @composer.observable  # type: ignore[untyped-decorator]
    def joints_vel(self) -> Any:
        """Joint velocities, shape (3,), rad/s."""
        return observable.MJCFFeature("qvel", self._entity.observable_joints)

    @property
    def proprioception(self) -> list[Any]:
        """Joint positions and velocities, then those of whatever is attached."""
        return [
            self.joints_pos,
            self.joints_vel,
            *self._collect_from_attachments("proprioception"),
        ]


class Leg(base.Walker):  # type: ignore[misc]
    """A three-joint leg on a fixed base; an action holds the joints' position targets [rad]."""

    def _build(self, name: str = "leg") -> None:
        """Loads the leg.

        Args:
            name: the walker's name, its prefix where it is attached.
        """
        self._mjcf_root = mjcf.from_path(str(LEG_XML))
        self._mjcf_root.model = name
        # A keyframe has the size of the whole model and would not compile once the leg is attached
        # beside anything else that moves, so the pose is kept here instead.
        home = self._mjcf_root.keyframe.key["home"]
        self._home: NDArray[np.float64] = np.array(home.qpos, dtype=float)
        self._home.flags.writeable = False
        home.remove()
        self._joints = tuple(self._mjcf_root.find_all("joint"))
        self._actuators = tuple(self._mjcf_root.find_all("actuator"))

    def _build_observables(self) -> LegObservables:
        return LegObservables(self)

    def create_root_joints(self, attachment_frame: Any) -> None:
        """Adds no joint: the base stays where it is attached.

        Args:
            attachment_frame: the frame that `arena.attach(leg)` returned.
        """

    def initialize_episode(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Puts the leg in its home pose, at rest, with the servos told to hold it.

        Args:
            physics: the compiled model.
            random_state: unused, home is always the same.
        """
        self.reinitialize_pose(physics, random_state)

    def reinitialize_pose(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Does what `initialize_episode` does; dm_control's tasks call it by this name.

        Args:
            physics: the compiled model.
            random_state: unused, home is always the same.
        """
        del random_state
        joints = physics.bind(self._joints)
        joints.qpos = self._home
        joints.qvel = 0.0
        physics.bind(self._actuators).ctrl = self._home

    @property
    def home(self) -> NDArray[np.float64]:
        """Joint positions at the start of an episode, shape (3,), rad, read-only."""
        return self._home

    @property
    def upright_pose(self) -> base.WalkerPose:
        """The home pose as dm_control's tasks ask for it."""
        return base.WalkerPose(qpos=self._home)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The root of the leg's MJCF."""
        return self._mjcf_root

    @property
    def root_body(self) -> mjcf.Element:
        """The fixed base."""
        return self._mjcf_root.find("body", "base")

    @property
    def observable_joints(self) -> Sequence[mjcf.Element]:
        """The joints `hip`, `thigh` and `calf`."""
        return self._joints

    @property
    def actuators(self) -> Sequence[mjcf.Element]:
        """The position servos, in the joints' order and with their names."""
        return self._actuators

    @property
    def end_effectors(self) -> Sequence[mjcf.Element]:
        """The body that carries the foot."""
        return (self._mjcf_root.find("body", "calf"),)

    @property
    def foot(self) -> mjcf.Element:
        """The site at the foot's centre."""
        return self._mjcf_root.find("site", "foot")

    @property
    def egocentric_camera(self) -> mjcf.Element:
        """A camera at the front of the base that looks ahead."""
        return self._mjcf_root.find("camera", "egocentric")
