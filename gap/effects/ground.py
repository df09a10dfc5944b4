"""The ground under a robot's feet, and under whatever else of it can touch what does not move.

A contact takes its numbers from the geom of higher priority, or mixes both; explicit pairs have
their own. So both sides and the pairs are changed alike, which changes every contact by just that.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from functools import partial
from types import MappingProxyType

import mujoco
import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.simulation.feet import Foot, find_feet, in_frame_of
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest
from walkerkit.gap.simulation.trials import Trials

# Of what the model has. Contacts that break and slip make a fit's slopes rough, so it takes steps
# of a tenth for them, and there are many starts.
_COARSE = 5.0
_LEAST_FRICTION = 1e-5  # MuJoCo takes no less
_HARDEST = 2.0  # timesteps; MuJoCo's contacts are no faster
_SOFTEST = 0.5  # s
_OFFSET, _SHORTEST = 0.02, 0.05  # of the distance of a foot from its shank's joint; m
_FRAMES = mujoco.mjtSameFrame
_NOT_THERE = {
    int(_FRAMES.mjSAMEFRAME_BODY): int(_FRAMES.mjSAMEFRAME_BODYROT),
    int(_FRAMES.mjSAMEFRAME_INERTIA): int(_FRAMES.mjSAMEFRAME_INERTIAROT),
}
_LOWEST, _HIGHEST = 0.02, 0.9999  # impedance; MuJoCo takes no more


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


def _friction(robot: Robot, site: str, given: Robot) -> float:
    """The least sliding coefficient that any contact with the ground has."""
    return float(GroundFriction._sizes(robot.model).min())


def _slowness(robot: Robot, site: str, given: Robot) -> float:
    """The least time constant of the geoms that touch the ground."""
    return float(GroundCompliance._sizes(robot.model).min())


def _softness(robot: Robot, site: str, given: Robot) -> float:
    """The least impedance of the geoms that touch the ground."""
    return float(_impedance(robot.model).min())


class GroundFriction(GroundEffect):
    """Feet slip sooner or later than the model says."""

    name = "ground_friction"
    part = "ground"
    equation = "|F_t| ≤ (μ + Δμ) F_n, Δμ: friction [1], of all contacts with the ground"
    symptom = "slip while in contact"
    added_as = "geom friction, of robot and ground"
    source = "MuJoCo XML reference, geom/friction; computation chapter, contact"
    fields = MappingProxyType({"friction": fields.Field(path="geom/friction", read=_friction)})

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The coefficient of sliding friction to add."""
        least = float(self._sizes(robot.model).min())
        return (
            Parameter(
                name="friction",
                unit="",
                lower=-0.95 * least,
                upper=max(3.0, 5 * least),
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
    """The ground gives way more softly, or less, than the model says.

    A contact of time constant T and impedance d leaves a foot 1 − d of what else acts on it, and
    adds a spring: a mass stands (1 − d) g T² deep. With d near 1, as is usual, only a long T is
    soft, and slow; what is soft and answers as fast as a real spring has a small d.
    """

    name = "ground_compliance"
    part = "ground"
    equation = (
        "contacts as springs of time constant T + ΔT at their damping ratio, of impedance d + Δd; "
        "ΔT: timeconst [s], Δd: impedance [1]"
    )
    symptom = "at touch-down, and as loads shift between feet"
    added_as = "geom solref and solimp, of robot and ground"
    source = "MuJoCo XML reference, geom/solref; computation chapter, solver parameters"
    fields = MappingProxyType(
        {
            "timeconst": fields.Field(path="geom/solref", read=_slowness),
            "impedance": fields.Field(path="geom/solimp", read=_softness),
        }
    )

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The time constant and the impedance to add."""
        model = robot.model
        least = float(self._sizes(model).min())
        room = max(least - _HARDEST * float(model.opt.timestep), 0.0)
        impedance = np.clip(_impedance(model), _LOWEST, _HIGHEST)
        # A contact is as soft as the greater of its two numbers.
        soft, hard = float(impedance.max(axis=1).min()), float(impedance.max())
        softest, hardest = _LOWEST - hard, _HIGHEST - float(impedance.min())
        # Slower, softer and harder springs.
        tries = [
            *([(-0.5 * room, 0.0), (-0.5 * room, -0.6 * soft)] if room else []),
            *((part * least, 0.0) for part in (0.25, 0.5, 1.0, 1.5, 2.5, 4.0, 7.0)),
            *((0.0, -part * soft) for part in (0.03, 0.1, 0.25, 0.5)),
            *((least, -part * soft) for part in (0.25, 0.5)),
            (0.0, 0.5 * (_HIGHEST - hard)),
        ]
        starts = dict.fromkeys((slow, max(change, softest)) for slow, change in tries)
        starts.pop((0.0, 0.0), None)
        slower, softer = zip(*starts, strict=True)
        return (
            Parameter(
                name="timeconst",
                unit="s",
                lower=-room,
                upper=max(_SOFTEST, 10 * least),
                end=-room,  # as hard as steps of this length allow
                scale=_COARSE * least,
                starts=slower,
            ),
            Parameter(
                name="impedance",
                unit="",
                lower=softest,
                upper=hardest,
                scale=_COARSE * 0.2 * min(soft, 0.9),
                starts=softer,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the time constants in `solref` and to the impedances in `solimp`."""
        ground = Ground(trials.robot.model)
        for name, ids in (("geom", ground.geoms), ("pair", ground.pairs)):
            solref = trials.field(f"{name}_solref")
            own = solref[:, ids]
            constant = _time_constant(own)
            softer = np.maximum(constant + values[:, :1], 0.01 * constant)
            ratio = constant / softer
            # Stiffness and damping are per unit of mass: 1/(T ζ)² and 2/T, negative.
            direct = np.stack([own[..., 0] * ratio**2, own[..., 1] * ratio], axis=-1)
            standard = np.stack([softer, own[..., 1]], axis=-1)
            solref[:, ids] = np.where(own[..., :1] > 0, standard, direct)
            solimp = trials.field(f"{name}_solimp")
            both = solimp[:, ids, :2]
            least, most = np.minimum(both, _LOWEST), np.maximum(both, _HIGHEST)
            solimp[:, ids, :2] = np.clip(both + values[:, 1:, None], least, most)

    @staticmethod
    def _sizes(model: mujoco.MjModel) -> FloatArray:
        ground = Ground(model)
        solref = [model.geom_solref[ground.geoms], model.pair_solref[ground.pairs]]
        return _time_constant(np.concatenate(solref))


def _place(column: int, robot: Robot, site: str, given: Robot) -> float:
    """Where the first geom of a foot is in its shank's frame, whatever it is welded on by [m].

    It is found in the robot as it was given: a foot that has moved may touch with another geom.
    """
    foot, model = _shanks(given)[site], robot.model
    (geom, *_), body = foot.geoms, model.body(site).id
    data = rest(model)
    mujoco.mj_kinematics(model, data)
    place = (data.geom_xpos[geom] - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
    return float(place[column])


class FootOffset(Effect):
    """A foot is elsewhere on its leg than the model says: a longer shank, a worn or other foot.

    What touches the ground is moved, and no mass.
    """

    name = "foot_offset"
    part = "ground"
    equation = "where the foot touches + Δr in the shank's frame, Δr: x, y, z [m]"
    symptom = "at touch-down; the base's height and attitude while it stands"
    added_as = "geom pos"
    source = "MuJoCo XML reference, geom/pos"
    kind = "body"
    fields = MappingProxyType(
        {
            axis: fields.Field(path="geom/pos", read=partial(_place, column))
            for column, axis in enumerate("xyz")
        }
    )

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The bodies that carry feet, but for the base itself."""
        return tuple(_shanks(robot))

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The three, in parts of the foot's distance from the shank's joint."""
        foot = _shanks(robot)[site]
        size = _OFFSET * max(foot.distance, _SHORTEST)
        starts = [
            [sign * 2 * size if axis == other else 0.0 for other in "zxy" for sign in (-1, 1)]
            for axis in "xyz"
        ]
        return tuple(
            Parameter(
                name=axis,
                unit="m",
                lower=-20 * size,
                upper=20 * size,
                scale=_COARSE * size,
                starts=tuple(own),
            )
            for axis, own in zip("xyz", starts, strict=True)
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds to the `geom_pos` of what of the foot can touch the ground first."""
        model = trials.robot.model
        foot = _shanks(trials.robot)[site]
        position, same = trials.field("geom_pos"), trials.field("geom_sameframe")
        moved = values.any(axis=1)
        for geom in foot.geoms:
            position[:, geom] += values @ in_frame_of(
                model, int(model.geom_bodyid[geom]), foot.body
            )
            # MuJoCo takes a geom at its body's origin, or centre of mass, to stay there.
            own = int(model.geom_sameframe[geom])
            same[moved, geom] = _NOT_THERE.get(own, own)


def _shanks(robot: Robot) -> dict[str, Foot]:
    """The feet by the names of the bodies that carry them, the base left out."""
    model, base = robot.model, robot.base
    if base is None:
        return {}
    feet = [foot for foot in find_feet(model, base) if foot.body != base.id]
    return {name: foot for foot in feet if (name := model.body(foot.body).name)}


def _impedance(model: mujoco.MjModel) -> FloatArray:
    """(n_contacts, 2) at the surface and deeper."""
    ground = Ground(model)
    solimp = [model.geom_solimp[ground.geoms, :2], model.pair_solimp[ground.pairs, :2]]
    return np.concatenate(solimp)


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
