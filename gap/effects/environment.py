"""What the robot is mounted on and runs into."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from types import MappingProxyType

import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, JointEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_MOST = 0.35  # rad; nobody overlooks twenty degrees


def _tilt(which: int, robot: Robot, site: str, given: Robot) -> float:
    """By how much gravity is rolled, then pitched, from that of the robot as it was given."""
    x, y, z = (float(part) for part in given.model.opt.gravity)
    new_x, new_y, new_z = (float(part) for part in robot.model.opt.gravity)
    across, angle = np.hypot(y, z), np.arctan2(z, y)
    turn = np.arccos(np.clip(new_y / across, -1.0, 1.0)) if across else angle
    rolls = np.array([turn - angle, -turn - angle])
    rolls = (rolls + np.pi) % (2 * np.pi) - np.pi
    roll = float(rolls[np.argmin(np.abs(rolls))])
    if which == 0:
        return roll
    z = float(np.sin(roll) * y + np.cos(roll) * z)
    pitch = np.arctan2(z, x) - np.arctan2(new_z, new_x)
    return float((pitch + np.pi) % (2 * np.pi) - np.pi)


class BaseTilt(Effect):
    """The base is not mounted level, so that gravity points elsewhere in its frame."""

    name = "base_tilt"
    part = "pose"
    equation = "g rotated by roll about x and pitch about y of the world frame [rad]"
    symptom = "sin(q + δ), all joints"
    added_as = "option/gravity"
    source = "MuJoCo XML reference, option/gravity"
    fields = MappingProxyType(
        {
            "roll": fields.Field(path="option/gravity", read=partial(_tilt, 0)),
            "pitch": fields.Field(path="option/gravity", read=partial(_tilt, 1)),
        }
    )
    kind = "robot"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole, where there is gravity."""
        return (EVERYWHERE,) if np.any(robot.model.opt.gravity) else ()

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Roll and pitch."""
        return tuple(
            Parameter(
                name=name,
                unit="rad",
                lower=-_MOST,
                upper=_MOST,
                scale=0.03,
                starts=tuple(0.06 * np.asarray(signs, dtype=float)),
            )
            for name, signs in (("roll", (1, -1, 0, 0)), ("pitch", (0, 0, 1, -1)))
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Rotates `opt.gravity` by roll, then pitch."""
        gravity = trials.field("opt.gravity")
        x, y, z = gravity.T.copy()
        (sr, sp), (cr, cp) = np.sin(values.T), np.cos(values.T)
        y, z = cr * y - sr * z, sr * y + cr * z
        x, z = cp * x + sp * z, cp * z - sp * x
        gravity[...] = np.stack([x, y, z], axis=1)


_STIFFEST = 1.0  # √(K/I) h; a stop is explicit in MuJoCo, and is not hit well by longer steps
_IMPEDANCE = 0.01  # small, so that a stop gives way like a spring; this much like a mass, too
_DAMPING_RATIO = 0.3


def _stop(side: int, robot: Robot, site: str, given: Robot) -> float | None:
    joint = robot.joints[site].id
    return float(robot.model.jnt_range[joint, side]) if robot.model.jnt_limited[joint] else None


def _hardness(which: int, robot: Robot, site: str, given: Robot) -> float | None:
    """Stiffness or damping ratio of a stop that is a spring; None of one that is none."""
    joint, model = robot.joints[site].id, robot.model
    stiffness, damping = (-float(number) for number in model.jnt_solref[joint])
    if not model.jnt_limited[joint] or stiffness <= 0:
        return None
    given_way = 1 - float(model.jnt_solimp[joint, 0])
    rate = np.sqrt(stiffness / given_way)
    if which == 0:
        return float(rate**2 * _inertia(given, site))
    return float(damping / given_way / (2 * rate))


class EndStop(JointEffect):
    """The joint runs into a stop where its model moves freely, or not yet.

    A stop is a damped spring that only pushes. MuJoCo's usual ones hold back accelerations instead,
    whatever makes them, so that their hardness is not one of a material.
    """

    name = "end_stop"
    part = "pose"
    equation = (
        "τ = −K r − 2 ζ √(K I) ṙ as far as it pushes back, r: q beyond lower or upper [rad], "
        "K: stiffness [N·m/rad], ζ: damping_ratio [1], I: the joint's inertia"
    )
    symptom = "at the limits"
    added_as = "joint range, solreflimit and solimplimit"
    source = "MuJoCo documentation, Computation: Solver parameters; XML reference, joint/range"
    fields = MappingProxyType(
        {
            "lower": fields.Field(path="joint/range", read=partial(_stop, 0)),
            "upper": fields.Field(path="joint/range", read=partial(_stop, 1)),
            "stiffness": fields.Field(path="joint/solreflimit", read=partial(_hardness, 0)),
            "damping_ratio": fields.Field(path="joint/solreflimit", read=partial(_hardness, 1)),
        }
    )

    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Any joint."""
        return True

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Both stops, unchanged far outside or where the model has them, and how hard they are."""
        joint, excursion = robot.joints[site], robot.excursion(site)
        low, high, width = excursion.lower, excursion.upper, excursion.range
        limited = bool(robot.model.jnt_limited[joint.id])
        span = robot.model.jnt_range[joint.id]
        known = (float(span[0]), float(span[1])) if limited else (low - width, high + width)
        unit = "m" if joint.slide else "rad"
        stiffest = (_STIFFEST / robot.model.opt.timestep) ** 2 * _inertia(robot, site)
        near, nearer = 0.02 * width, 0.1 * width
        return (
            Parameter(
                name="lower",
                unit=unit,
                zero=known[0],
                lower=min(known[0], low - width),
                upper=max(known[0], low + 0.45 * width),
                scale=near,
                starts=(low + near, low + near, known[0], low + nearer),
            ),
            Parameter(
                name="upper",
                unit=unit,
                zero=known[1],
                lower=min(known[1], high - 0.45 * width),
                upper=max(known[1], high + width),
                scale=near,
                starts=(high - near, known[1], high - near, high - nearer),
            ),
            Parameter(
                name="stiffness",
                unit="N/m" if joint.slide else "N·m/rad",
                # Not at the bound, where a stop that is as hard as can be is a change.
                zero=0.9 * stiffest,
                lower=1e-3 * stiffest,
                upper=stiffest,
                scale=0.05 * stiffest,
                starts=(0.3 * stiffest,) * 4,
                shape=not limited,
            ),
            Parameter(
                name="damping_ratio",
                unit="1",
                zero=_DAMPING_RATIO,
                lower=0.02,
                upper=2.0,
                end=0.02,  # below which a simulation's own damping is more
                scale=0.1,
                starts=(_DAMPING_RATIO,) * 4,
                shape=not limited,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Sets `jnt_range` and how its stops give way, and switches them on where they moved."""
        robot, joint = trials.robot, trials.robot.joints[site]
        zero = np.array([parameter.zero for parameter in self.parameters(robot, site)])
        moved = values[:, :2] != zero[:2]
        some, changed = moved.any(axis=1), (values != zero).any(axis=1)
        limited, span = trials.field("jnt_limited"), trials.field("jnt_range")[:, joint.id]
        # A stop that was not moved stays where it is, be it that other effects have moved it.
        own = np.where(limited[:, [joint.id]], span, values[:, :2])
        span[some] = np.where(moved, values[:, :2], own)[some]
        limited[some, joint.id] = True
        # A stop makes (k r + b v)/R, with R (1 − d)/d of what an effort accelerates and k, b these
        # numbers over d (MuJoCo, Computation: Constraint model).
        rate = np.sqrt(values[:, 2] / _inertia(robot, site))
        spring = (1 - _IMPEDANCE) * np.stack([rate**2, 2 * values[:, 3] * rate], axis=1)
        trials.field("jnt_solref")[changed, joint.id] = -spring[changed]
        trials.field("jnt_solimp")[changed, joint.id, :2] = _IMPEDANCE


def _inertia(robot: Robot, joint: str) -> float:
    """What an effort at a joint moves in the reference pose, the other joints free."""
    return 1 / float(robot.model.dof_invweight0[robot.joints[joint].dof])
