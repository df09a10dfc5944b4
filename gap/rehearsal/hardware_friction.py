"""Friction of the rehearsal robot's joints: oil that drags and bristles that bend and slide.

    friction = Friction(model, drives, hidden, step=2.5e-4, n_sims=3)
    effort = friction.effort(qvel, q, load)      # against the motion, one step after the last call

Every kind of dry friction, whatever it depends on, is a level that one set of bristles settles at
when it slides. Arrays of joints are in the order of the drives; qvel and efforts are of every
degree of freedom, shape (n_sims, nv).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import mujoco
import numpy as np

from walkerkit.gap.rehearsal.hardware_drive import Array, Drives
from walkerkit.gap.rehearsal.hardware_motor import waves
from walkerkit.gap.rehearsal.hidden import HiddenEffect

PRESLIDING: Final = 5e-4
"""How far a bristle bends before it slides, rad (m for slide joints)."""

_Level = Callable[[Array, Array, Array], Array]
_DRY = (
    "asymmetric_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "directional_efficiency",
    "pose_dependent_friction",
)


class Bristles:
    """Dry friction as bristles that bend and then slide (Dahl; LuGre where the level varies).

    F' = σ (q̇ − |q̇| F / Fc) with σ = Fc / bend: F springs back while it sticks and settles at
    Fc sgn q̇ in sliding. Over a step of constant velocity that is solved exactly, so that no bristle
    is too stiff for the friction itself (Canudas de Wit et al., "A new model for control of systems
    with friction", 1995).
    """

    def __init__(
        self,
        frictionloss: Array,
        inertia: Array,
        step: float,
        n_sims: int,
        *,
        bend: float | Array = PRESLIDING,
    ) -> None:
        """Bristles at rest.

        Args:
            frictionloss: dry friction Fc, shape (nv,), N·m.
            inertia: what a bristle has to hold back, shape (nv,), kg·m².
            step: time between two updates, s.
            n_sims: number of simulations.
            bend: how far they bend before they slide, shape (nv,) or one for all, rad.
        """
        self._own = frictionloss
        self._bend = bend
        # The bristle's spring drives the inertia explicitly: keep its frequency below 1/step.
        self._softening = step**2 / inertia
        self._step = step
        self._force = np.zeros((n_sims, frictionloss.size))

    def torque(self, qd: Array, level: Array | None = None) -> Array:
        """Effort of the bristles on the joints, one step after the last call, N·m.

        Args:
            qd: velocities over that step, shape (n_sims, nv), rad/s.
            level: dry friction of the moment, shape (n_sims, nv), N·m; by default as at first.

        Returns:
            Effort against the motion, shape (n_sims, nv).
        """
        level = self._own if level is None else level
        bend = np.maximum(self._bend, level * self._softening)
        stay = np.exp(-np.abs(qd) * self._step / bend)
        self._force = stay * self._force + (1 - stay) * level * np.sign(qd)
        return -self._force


class Friction:
    """All friction of several simulations."""

    def __init__(
        self,
        model: mujoco.MjModel,
        drives: Drives,
        hidden: Sequence[HiddenEffect],
        *,
        step: float,
        n_sims: int,
    ) -> None:
        """Friction of joints at rest.

        Args:
            model: the rigid bodies.
            drives: the drives, with the damping and Coulomb friction that they know of.
            hidden: effects; those that are no friction are left alone.
            step: time between two calls, s.
            n_sims: number of simulations.
        """
        names = drives.joints
        inertia = 1.0 / model.dof_invweight0
        self._drives = drives
        self._bristles = Bristles(drives.frictionloss, inertia, step, n_sims)
        self._has_dry = bool(drives.frictionloss.any())
        self._levels = [_level(e, names) for e in hidden if e.effect in _DRY]
        self._soft = []
        for effect in (e for e in hidden if e.effect == "presliding_friction"):
            limit, bend = np.zeros(model.nv), np.full(model.nv, PRESLIDING)
            limit[drives.dofs] = effect.spread("frictionloss", names)
            bend[drives.dofs] = effect.spread("bend", names, elsewhere=PRESLIDING)
            self._soft.append(Bristles(limit, inertia, step, n_sims, bend=bend))
        gears = [e for e in hidden if e.effect == "directional_efficiency"]
        self._kept = np.zeros(len(names))
        self._keeps = bool(gears)
        for effect in gears:
            both = [effect.spread(way, names, elsewhere=1.0) for way in ("driving", "backdriving")]
            self._kept += 1.0 - np.mean(both, axis=0)

    def effort(self, qvel: Array, q: Array, load: Array) -> Array:
        """Effort against the motion, and what a gear that is less than perfect keeps, N·m.

        Args:
            qvel: velocities of all degrees of freedom, shape (n_sims, nv), rad/s.
            q: positions of the joints, shape (n_sims, n_joints), rad.
            load: effort that the drives put on their gears, shape (n_sims, n_joints), N·m.
        """
        drives = self._drives
        level = None
        if self._levels:
            speed = qvel[:, drives.dofs]
            level = np.repeat(drives.frictionloss[None], len(qvel), axis=0)
            level[:, drives.dofs] += sum(of(q, speed, load) for of in self._levels)
        effort = drives.drag(qvel)
        if self._has_dry or self._levels:
            effort += self._bristles.torque(qvel, level)
        for bristles in self._soft:
            effort += bristles.torque(qvel)
        if self._keeps:
            effort[:, drives.dofs] -= self._kept * load
        return effort


def _level(effect: HiddenEffect, names: Sequence[str]) -> _Level:
    """The dry friction that an effect adds, as a function of pose, speed and load of the joints."""

    def at(parameter: str, elsewhere: float = 0.0) -> Array:
        return effect.spread(parameter, names, elsewhere=elsewhere)

    match effect.effect:
        case "asymmetric_friction":
            forward, backward = at("forward"), at("backward")
            return lambda q, speed, load: np.where(speed > 0, forward, backward)
        case "stribeck_friction":
            most, slow = at("breakaway"), at("velocity", 1.0)
            return lambda q, speed, load: most * np.exp(-np.abs(speed) / slow)
        case "load_dependent_friction":
            coefficient = at("coefficient")
            return lambda q, speed, load: coefficient * np.abs(load)
        case "directional_efficiency":
            lost = 0.5 * (at("backdriving", 1.0) - at("driving", 1.0))
            return lambda q, speed, load: lost * np.abs(load)
    amplitude, periods, phase = waves(effect, names)
    return lambda q, speed, load: 0.5 * amplitude * (1.0 + np.sin(periods * q + phase))
