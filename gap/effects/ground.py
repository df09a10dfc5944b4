"""The ground under a robot's feet, and under whatever else of it can touch what does not move.

A contact takes its numbers from the geom of higher priority, or mixes both; explicit pairs have
their own. So both sides and the pairs are changed alike, which changes every contact by just that.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence

import mujoco
import numpy as np

from walkerkit.gap.effects.base import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.simulation.ground import Ground
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

# Of what the model has. Contacts that break and slip make a fit's slopes rough, so it takes steps
# of a tenth for them, and there are many starts.
_COARSE = 5.0
_LEAST_FRICTION = 1e-5  # MuJoCo takes no less
_HARDEST = 2.0  # timesteps; MuJoCo's contacts are no faster
_SOFTEST = 0.5  # s


class GroundEffect(Effect):
    """An effect of all contacts with the ground."""

    kind = "robot"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole, where its contacts with the ground have what the effect changes."""
        return (EVERYWHERE,) if self._sizes(robot.model).size else ()

    @staticmethod
    @abc.abstractmethod
    def _sizes(model: mujoco.MjModel) -> FloatArray:
        """What the model has of it, (n_contacts,); empty where it cannot act."""


class GroundFriction(GroundEffect):
    """Feet slip sooner or later than the model says."""

    name = "ground_friction"
    equation = "|F_t| ≤ (μ + Δμ) F_n, Δμ: friction [1], of all contacts with the ground"
    symptom = "slip while in contact"
    added_as = "geom friction, of robot and ground"
    source = "MuJoCo XML reference, geom/friction; computation chapter, contact"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The coefficient of sliding friction to add."""
        least = float(self._sizes(robot.model).min())
        return (
            Parameter(
                name="friction",
                unit="",
                lower=-0.95 * least,
                upper=3 * max(least, 1.0),
                scale=_COARSE * least,
                starts=tuple(
                    part * least for part in (-0.75, -0.6, -0.45, -0.3, -0.15, 0.2, 0.5, 1.0)
                ),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the sliding `geom_friction` and `pair_friction`."""
        ground = Ground(trials.robot.model)
        for name, ids, width in (("geom", ground.geoms, 1), ("pair", ground.pairs, 2)):
            friction = trials.field(f"{name}_friction")
            own = friction[:, ids, :width]
            least = np.minimum(own, _LEAST_FRICTION)
            friction[:, ids, :width] = np.maximum(own + values[:, :, None], least)

    @staticmethod
    def _sizes(model: mujoco.MjModel) -> FloatArray:
        ground = Ground(model)
        fixed, moving = ground.contacts.T
        slides = np.maximum(model.geom_condim[fixed], model.geom_condim[moving]) > 1
        fixed, moving = fixed[slides], moving[slides]
        higher = np.sign(model.geom_priority[fixed] - model.geom_priority[moving])
        own, other = model.geom_friction[fixed, 0], model.geom_friction[moving, 0]
        mixed = np.where(higher > 0, own, np.where(higher < 0, other, np.maximum(own, other)))
        pairs = ground.pairs[model.pair_dim[ground.pairs] > 1]
        sizes = np.concatenate([mixed, model.pair_friction[pairs, 0]])
        return sizes[sizes > _LEAST_FRICTION]


class GroundCompliance(GroundEffect):
    """The ground gives way more softly, or less, than the model says."""

    name = "ground_compliance"
    equation = (
        "contacts as springs of time constant T + ΔT at their damping ratio, ΔT: timeconst [s]"
    )
    symptom = "at touch-down, and as loads shift between feet"
    added_as = "geom solref, of robot and ground"
    source = "MuJoCo XML reference, geom/solref; computation chapter, solver parameters"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The time constant to add."""
        least = float(self._sizes(robot.model).min())
        room = max(least - _HARDEST * float(robot.model.opt.timestep), 0.0)
        return (
            Parameter(
                name="timeconst",
                unit="s",
                lower=-0.9 * room,
                upper=max(_SOFTEST, 10 * least),
                scale=_COARSE * least,
                starts=(
                    *((-0.5 * room,) if room else ()),
                    *(part * least for part in (0.25, 0.5, 1.0, 1.5, 2.5, 4.0, 7.0)),
                ),
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the time constants in `geom_solref` and `pair_solref`."""
        ground = Ground(trials.robot.model)
        for name, ids in (("geom", ground.geoms), ("pair", ground.pairs)):
            solref = trials.field(f"{name}_solref")
            own = solref[:, ids]
            constant = _time_constant(own)
            softer = np.maximum(constant + values, 0.01 * constant)
            ratio = constant / softer
            # Stiffness and damping are per unit of mass: 1/(T ζ)² and 2/T, negative.
            direct = np.stack([own[..., 0] * ratio**2, own[..., 1] * ratio], axis=-1)
            standard = np.stack([softer, own[..., 1]], axis=-1)
            solref[:, ids] = np.where(own[..., :1] > 0, standard, direct)

    @staticmethod
    def _sizes(model: mujoco.MjModel) -> FloatArray:
        ground = Ground(model)
        solref = [model.geom_solref[ground.geoms], model.pair_solref[ground.pairs]]
        return _time_constant(np.concatenate(solref))


def _time_constant(solref: FloatArray) -> FloatArray:
    """(..., 2) → (...) s, of either format: positive (T, ζ), or negative stiffness and damping."""
    first, second = solref[..., 0], solref[..., 1]
    damped = second < 0
    from_damping = 2 / np.where(damped, -second, 1.0)
    from_stiffness = 1 / np.sqrt(np.where(first < 0, -first, 1.0))
    constant: FloatArray = np.where(
        first > 0, first, np.where(damped, from_damping, from_stiffness)
    )
    return constant
