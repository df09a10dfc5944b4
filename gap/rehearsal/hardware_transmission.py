"""Between motor and link of the rehearsal robot: rotors of their own, teeth, springs and stops.

    transmission = Transmission(model, drives, hidden, step=2.5e-4, n_sims=3)   # before the batch
    angle, speed = transmission.motor_side(q, qd)
    effort = transmission.link_effort(torque, q, qd)       # moves the rotors by a step

A joint with backlash or an elastic gear has a rotor with an angle and a speed of its own; its
inertia is the joint's armature, which the link then loses. Encoders sit on the motors. All other
joints are rigid: motor and link are one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_drive import Array, Drives
from walkerkit.gap.rehearsal.hidden import HiddenEffect, total

TEETH: Final = 120.0
"""Frequency at which teeth in contact bounce, Hz."""
STOP: Final = 40.0
"""Frequency at which a joint bounces on its end stop, Hz."""

_SUBSTEPS: Final = 4  # of the rotors in one of the bodies
_TEETH_DAMPING, _SPRING_DAMPING, _STOP_DAMPING = 0.5, 0.03, 0.3


class Transmission:
    """The gears of all joints of several simulations."""

    def __init__(
        self,
        model: mujoco.MjModel,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        n_sims: int,
    ) -> None:
        """Gears at rest; takes the armature of joints with a rotor out of the model.

        Args:
            model: the rigid bodies, whose `dof_armature` is written to.
            drives: the drives.
            hidden: effects; those that are no transmission's are left alone.
            step: time between two calls, s.
            n_sims: number of simulations.

        Raises:
            InputError: a joint that needs a rotor has no armature.
        """
        names = drives.joints
        play = total(hidden, "backlash", "width", names)
        softness = np.zeros(len(names))
        for effect in (e for e in hidden if e.effect == "series_elasticity"):
            softness += 1.0 / effect.spread("stiffness", names, elsewhere=np.inf)
        self._at = np.flatnonzero((play > 0) | (softness > 0))
        self.any = bool(self._at.size)
        """There is a rotor."""
        dofs = drives.dofs[self._at]
        rotor = model.dof_armature[dofs].copy()
        for name, inertia in zip(np.array(names)[self._at], rotor, strict=True):
            if not inertia > 0:
                raise InputError(
                    f"joint {str(name)!r} has no armature, which is the inertia of the rotor "
                    "behind backlash and elastic gears; give it one in the model"
                )
        link = np.maximum(1.0 / model.dof_invweight0[dofs] - rotor, 0.1 * rotor)
        model.dof_armature[dofs] = 0.0
        self._inertia: Array = rotor
        reduced = rotor * link / (rotor + link)
        teeth = reduced * (2 * np.pi * TEETH) ** 2
        soft = softness[self._at]
        self._stiffness: Array = np.where(soft > 0, 1.0 / np.where(soft > 0, soft, 1.0), teeth)
        ratio = np.where(soft > 0, _SPRING_DAMPING, _TEETH_DAMPING)
        self._damping: Array = 2 * ratio * np.sqrt(self._stiffness * reduced)
        self._half: Array = 0.5 * play[self._at]
        self._step = step / _SUBSTEPS
        self._angle: Array | None = None
        self._speed = np.zeros((n_sims, self._at.size))

    def motor_side(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Angles and speeds of the motors, at the joints.

        Args:
            q: positions of the links, shape (n_sims, n_joints), rad.
            qd: their velocities, shape as `q`, rad/s.
        """
        if not self.any:
            return q, qd
        if self._angle is None:
            self._angle = q[:, self._at].copy()
        q, qd = q.copy(), qd.copy()
        q[:, self._at], qd[:, self._at] = self._angle, self._speed
        return q, qd

    def link_effort(self, torque: Array, q: Array, qd: Array) -> Array:
        """What reaches the links, over the step that the motors now make, N·m.

        Args:
            torque: of the motors, at the joints, shape (n_sims, n_joints), N·m.
            q: positions of the links, shape as `torque`, rad.
            qd: their velocities, shape as `torque`, rad/s.
        """
        if not self.any:
            return torque
        driving, link, link_speed = torque[:, self._at], q[:, self._at], qd[:, self._at]
        angle = link if self._angle is None else self._angle
        speed, passed = self._speed, np.zeros_like(driving)
        for _ in range(_SUBSTEPS):
            contact = self._contact(angle - link, speed - link_speed)
            passed += contact
            speed = speed + self._step / self._inertia * (driving - contact)
            angle = angle + self._step * speed
            link = link + self._step * link_speed
        self._angle, self._speed = angle, speed
        effort = torque.copy()
        effort[:, self._at] = passed / _SUBSTEPS
        return effort

    def _contact(self, twist: Array, rate: Array) -> Array:
        """Effort between rotor and link; teeth only push."""
        bent = twist - np.minimum(np.maximum(twist, -self._half), self._half)
        effort = self._stiffness * bent + self._damping * rate
        pushing = (self._half == 0) | ((bent != 0) & (effort * bent > 0))
        contact: Array = np.where(pushing, effort, 0.0)
        return contact


class Stops:
    """End stops inside the joints' ranges: stiff springs that only push."""

    def __init__(
        self, model: mujoco.MjModel, drives: Drives, hidden: Sequence[HiddenEffect]
    ) -> None:
        """Stops of a robot.

        Args:
            model: the rigid bodies.
            drives: the drives.
            hidden: effects; those that are no end stops are left alone.
        """
        names = drives.joints
        stops = [e for e in hidden if e.effect == "end_stop"]
        self.any = bool(stops)
        """There is one."""
        none = np.full(len(names), np.inf)
        self._lower: Array = np.max(
            [-none, *(e.spread("lower", names, elsewhere=-np.inf) for e in stops)], axis=0
        )
        self._upper: Array = np.min(
            [none, *(e.spread("upper", names, elsewhere=np.inf) for e in stops)], axis=0
        )
        inertia = 1.0 / model.dof_invweight0[drives.dofs]
        self._stiffness: Array = inertia * (2 * np.pi * STOP) ** 2
        self._damping: Array = 2 * _STOP_DAMPING * inertia * 2 * np.pi * STOP

    def effort(self, q: Array, qd: Array) -> Array:
        """Effort of the stops on the joints, N·m.

        Args:
            q: positions, shape (n_sims, n_joints), rad.
            qd: velocities, shape as `q`, rad/s.
        """
        under, over = np.maximum(self._lower - q, 0.0), np.maximum(q - self._upper, 0.0)
        resisted = self._damping * qd
        below = np.where(under > 0, np.maximum(self._stiffness * under - resisted, 0.0), 0.0)
        above = np.where(over > 0, np.maximum(self._stiffness * over + resisted, 0.0), 0.0)
        return below - above
