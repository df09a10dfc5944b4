"""A walker whose joint observables read as the robot's encoders do.

    walker = mended.made(SensedWalker)
    walker.reads(measurement, plays)

`joints_pos` and `joints_vel` are what the encoders show, late by what the log was late;
`applied_effort` and `computed_effort` are what the drives report. The drives themselves and all
other observables are the physics' own.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from walkerkit.gap.simulation.reading import Reading
from walkerkit.gap.simulation.robot import Measurement
from walkerkit.walkers.mjcf_walker import MjcfWalker, MjcfWalkerObservables
from walkerkit.walkers.robot_file import escaped

FloatArray = NDArray[np.float64]


class SensedObservables(MjcfWalkerObservables):
    """The observables of a walker, of which those of the joints are what is read of them."""

    @composer.observable  # type: ignore[untyped-decorator]
    def joints_pos(self) -> Any:
        """Positions as they are read, (n,) rad; m."""
        return observable.Generic(lambda physics: self._entity.read(physics)[0])

    @composer.observable  # type: ignore[untyped-decorator]
    def joints_vel(self) -> Any:
        """Velocities as they are read, (n,) rad/s; m/s."""
        return observable.Generic(lambda physics: self._entity.read(physics)[1])

    @composer.observable  # type: ignore[untyped-decorator]
    def computed_effort(self) -> Any:
        """What the laws asked for, as the drives report it, (n_actuated,) N·m."""
        return observable.Generic(
            lambda _: self._entity.reported(self._entity.actuator_group.computed_effort)
        )

    @composer.observable  # type: ignore[untyped-decorator]
    def applied_effort(self) -> Any:
        """What was left of it after their limits, as they report it, (n_actuated,) N·m."""
        return observable.Generic(
            lambda _: self._entity.reported(self._entity.actuator_group.applied_effort)
        )


class SensedWalker(MjcfWalker):
    """A walker between whose joints and observables lies what lies between joint and log."""

    _measurement: Mapping[str, Measurement] = {}
    _plays: Mapping[str, str] = {}

    def reads(self, measurement: Mapping[str, Measurement], plays: Mapping[str, str]) -> None:
        """Says how the joints are read.

        Args:
            measurement: joint to what lies between it and its log; absent means nothing.
            plays: joint to the joint behind it that is its play.
        """
        self._measurement = {escaped(name): of for name, of in measurement.items()}
        self._plays = {escaped(name): escaped(play) for name, play in plays.items()}
        names = self._names(self.observable_joints)
        known = [self._measurement.get(name, Measurement()) for name in names]
        self._delay = np.array([one.position_delay for one in known])
        self._share = np.array([one.load_side for one in known])
        self._reading = Reading(
            np.array([one.encoder_gain for one in known]),
            np.array(
                [[one.error_amplitude, one.error_periods, one.error_phase] for one in known]
            ).reshape(-1, 3),
        )
        behind = [
            self.mjcf_model.find("joint", self._plays[name]) if name in self._plays else None
            for name in names
        ]
        self._behind = [joint if self._share[k] else None for k, joint in enumerate(behind)]
        self._past: deque[tuple[float, FloatArray]] = deque()

    # What composer calls.

    def _build_observables(self) -> SensedObservables:
        return SensedObservables(self)

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Forgets what was read in the last episode."""
        super().initialize_episode(physics, random_state)
        self._past.clear()

    def after_substep(self, physics: Any, random_state: Any) -> None:
        """Keeps what is read late."""
        super().after_substep(physics, random_state)
        if self._delay.any():
            self._keep(physics)

    # What its observables show.

    def read(self, physics: Any) -> FloatArray:
        """(2, n) positions and velocities of the observed joints as they are read."""
        if not self._delay.any():
            return self._at_encoder(physics)
        if not self._past:  # the robot was there before the episode
            self._keep(physics)
        times = np.array([time for time, _ in self._past])
        values = np.stack([shown for _, shown in self._past])
        when = float(physics.time()) - self._delay
        return np.stack(
            [[np.interp(t, times, values[:, row, k]) for k, t in enumerate(when)] for row in (0, 1)]
        )

    def reported(self, effort: FloatArray) -> FloatArray:
        """(n_actuated,) efforts as the drives report them."""
        names = self.actuator_group.joint_names
        known = [self._measurement.get(name, Measurement()) for name in names]
        scale = np.array([one.effort_scale for one in known])
        offset = np.array([one.effort_offset for one in known])
        return np.asarray(scale * effort + offset)

    def _keep(self, physics: Any) -> None:
        step = float(physics.timestep())
        most = math.ceil(float(self._delay.max()) / step) + 2
        while len(self._past) >= most:
            self._past.popleft()
        self._past.append((float(physics.time()), self._at_encoder(physics)))

    def _at_encoder(self, physics: Any) -> FloatArray:
        """What the encoders show now, (2, n)."""
        joints = physics.bind(self.observable_joints)
        q, qd = np.array(joints.qpos, dtype=float), np.array(joints.qvel, dtype=float)
        for k, play in enumerate(self._behind):
            if play is not None:
                behind = physics.bind(play)
                q[k] += self._share[k] * float(behind.qpos[0])
                qd[k] += self._share[k] * float(behind.qvel[0])
        return np.stack([self._reading.position(q), self._reading.velocity(q, qd)])

    def _names(self, joints: Any) -> list[str]:
        space = self.mjcf_model.namescope
        return [str(joint.prefixed_identifier(prefix_root=space)) for joint in joints]
