"""What a robot on its feet is asked to do: paths of its base and of the soles that it lifts.

    for motion in MOTIONS:
        path = motion.path(stand, time, size=1.0, seed=0)      # raises OutOfReachError
        path.shift, path.turn, path.lifted

Sizes are in parts of the robot: how far its centre of mass is from the edges of its support
polygon, and how high its base is. Frequencies go up to `TOP` of the slowest mode that the robot has
on its servos (`Stand.bandwidth`): faster targets would be a test of that resonance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from walkerkit.gap.standing.reach import Reach
from walkerkit.gap.standing.standing_pose import Stand
from walkerkit.tasks.excitation import BATTERY, chirp

FloatArray = NDArray[np.float64]

TOP: Final = 0.7
"""Part of the slowest mode's frequency up to which a robot is moved."""

STILL: Final = 1.0
"""Time at rest at both ends of a motion [s]."""

_SLOWEST, _LEAST_TOP, _MOST_TOP = 0.2, 0.6, 3.0  # Hz
_FULL = 0.5  # Hz, up to which a motion has its full size; its speed is the same from there on
_SHIFT = 0.5  # of the way from the centre of mass to the edge
_ROUND = 0.15  # s
_TWIST, _TILT = 0.25, 0.08  # rad
_SQUAT = 0.2  # of the base's height
_LIFT, _DEEP, _LEAST_DEPTH = 0.2, 0.75, 0.012  # of that height; of the polygon's depth; m
_LEAN_TIME, _LIFT_TIME = 0.9, 0.35  # s
_HOP, _CROUCH = 0.15, 0.22  # of that height, which a hop is to reach, and its way up
_HOPS, _CROUCH_TIME, _FOLLOWS = 3, 0.8, 0.01  # s, s
_SOFT = 0.9  # of gravity, by which a landing slows down


class OutOfReachError(Exception):
    """A motion cannot be drawn for a robot; the text says why, without a full stop."""


@dataclass(frozen=True, kw_only=True)
class Path:
    """What base and soles are to do.

    Attributes:
        shift: (T, 3) of the base from where it stands, in the world's frame [m].
        turn: (T, 3) of it, a rotation vector about the world's axes [rad].
        lifted: (T, n_soles) of the soles from where they stand [m].
        carries: (T, n_soles) how much of the load soles may take, in [0, 1], against each other.
        flies: whether all soles leave the ground at once.
    """

    shift: FloatArray
    turn: FloatArray
    lifted: FloatArray
    carries: FloatArray
    flies: bool = False

    def at(self, time: FloatArray, others: FloatArray) -> Path:
        """The same at other times than its own [s]."""

        def read(values: FloatArray) -> FloatArray:
            return np.stack([np.interp(others, time, one) for one in values.T], axis=1)

        return replace(
            self,
            shift=read(self.shift),
            turn=read(self.turn),
            lifted=read(self.lifted),
            carries=read(self.carries),
        )


Draw = Callable[[Stand, FloatArray, float, int], Path]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A motion of a robot on its feet.

    Attributes:
        name: its name, as in file names.
        purpose: what it tells, for the README.
        draw: its path, from the stand, times at which it is wanted [s], its size up to 1 and a
            seed.
        seconds: how long it takes [s]; None for as long as is wanted.
    """

    name: str
    purpose: str
    draw: Draw
    seconds: Callable[[Stand], float] | None = None


def _shift(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """The centre of mass to and fro, along x and y, at a constant slow speed."""
    room = size * _SHIFT * _margins(stand)
    return _moved(stand, time, seed, (0, 1), room, "slow_triangle")


def _sway(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """The same, faster and faster."""
    room = size * 0.6 * _SHIFT * _margins(stand)
    return _moved(stand, time, seed, (0, 1), room, "chirp")


def _twist(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """The trunk about all of its axes, most of all about the vertical one."""
    room = size * np.array([_TILT, _TILT, _TWIST])
    return _moved(stand, time, seed, (3, 4, 5), room, "chirp")


def _squat(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """Down and up, faster and faster."""
    half = 0.5 * size * _SQUAT * stand.height
    path = _moved(stand, time, seed, (2,), np.array([half]), "chirp")
    # From a lower middle: legs that are nearly straight have no room upwards.
    path.shift[:, 2] -= 0.8 * half * _ends(time)
    return path


def _lift(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """One foot after the other off the ground, the weight over the others before."""
    del seed
    count = len(stand.soles)
    leans = [_lean(stand, sole) for sole in range(count)]
    path = _still(stand, time)
    one = _lift_cycle()
    for sole, lean in enumerate(leans):
        phase = time - STILL - sole * one
        over = _smooth(phase / _LEAN_TIME) - _smooth((phase - one + _LEAN_TIME) / _LEAN_TIME)
        path.shift[:, :2] += over[:, None] * lean
        up = _smooth((phase - _LEAN_TIME) / _LIFT_TIME)
        down = _smooth((phase - _LEAN_TIME - 2 * _LIFT_TIME) / _LIFT_TIME)
        path.lifted[:, sole] += size * _LIFT * stand.height * (up - down)
        path.carries[:, sole] -= over
    return path


def _lift_cycle() -> float:
    return 2 * _LEAN_TIME + 3 * _LIFT_TIME


def _hop(stand: Stand, time: FloatArray, size: float, seed: int) -> Path:
    """A crouch, a push at a constant acceleration, a flight, a landing that gives way; thrice."""
    del seed
    gravity = float(np.linalg.norm(stand.robot.model.opt.gravity))
    deep = _CROUCH * stand.height
    speed = np.sqrt(2 * gravity * size * _HOP * stand.height)
    push, flight, yields = 2 * deep / speed, 2 * speed / gravity, 2 * speed / (_SOFT * gravity)
    path = _still(stand, time)
    for number in range(_HOPS):
        phase = time - STILL - number * _HOP_CYCLE
        pushed = phase - _CROUCH_TIME
        flown = pushed - push
        landed = flown - flight
        pieces = [
            -deep * _smooth(phase / (0.8 * _CROUCH_TIME)),
            -deep + 0.5 * speed / push * pushed**2,
            speed * flown - 0.5 * gravity * flown**2,
            -speed * landed * np.exp(-np.maximum(landed, 0.0) / yields),
        ]
        stages = [phase <= 0, pushed <= 0, flown <= 0, landed <= 0]
        here = (phase > 0) & (phase <= _HOP_CYCLE)
        path.shift[here, 2] = np.select(stages, [np.zeros_like(time), *pieces[:3]], pieces[3])[here]
        flies = (flown > 0) & (landed <= 0)
        # A leg does not stop at once as it takes off.
        path.lifted[flies] = np.maximum(pieces[2] - _FOLLOWS * speed, 0.0)[flies, None]
        path.carries[flies] = 0.0
    return replace(path, flies=True)


_HOP_CYCLE = 2.8  # s

MOTIONS: Final = (
    Motion(
        name="shift",
        purpose="weight to and fro, slowly: gravity, masses, dry friction, which foot carries what",
        draw=_shift,
    ),
    Motion(
        name="sway",
        purpose="the same, faster and faster: gains, delays, damping",
        draw=_sway,
    ),
    Motion(
        name="twist",
        purpose="the trunk turns: hips, inertia of the trunk, friction of the ground",
        draw=_twist,
    ),
    Motion(
        name="squat",
        purpose="down and up, faster and faster: knees, payload, strength",
        draw=_squat,
    ),
    Motion(
        name="lift",
        purpose="one foot after the other: each leg alone, the ground as a foot lands",
        draw=_lift,
        seconds=lambda stand: 2 * STILL + len(stand.soles) * _lift_cycle(),
    ),
    Motion(
        name="hop",
        purpose="small hops: ground, strength at speed, delays as it lands",
        draw=_hop,
        seconds=lambda stand: 2 * STILL + _HOPS * _HOP_CYCLE,
    ),
)
"""From the slowest to the fastest."""


def top_frequency(stand: Stand) -> float:
    """The highest frequency at which a robot is moved [Hz]."""
    return float(np.clip(TOP * stand.bandwidth, _LEAST_TOP, _MOST_TOP))


def _still(stand: Stand, time: FloatArray) -> Path:
    rows, count = len(time), len(stand.soles)
    return Path(
        shift=np.zeros((rows, 3)),
        turn=np.zeros((rows, 3)),
        lifted=np.zeros((rows, count)),
        carries=np.ones((rows, count)),
    )


def _moved(
    stand: Stand,
    time: FloatArray,
    seed: int,
    axes: tuple[int, ...],
    room: FloatArray,
    signal: str,
) -> Path:
    """A path along x, y, z and about them, the axes that are given within ± their room."""
    path = _still(stand, time)
    moves = (time >= STILL) & (time <= time[-1] - STILL)
    rng = np.random.default_rng(seed)
    if signal == "chirp":
        drawn = chirp(
            time[moves],
            lower=-room,
            upper=room,
            rng=rng,
            max_velocity=2 * np.pi * _FULL * room,
            start_frequency=_SLOWEST,
            end_frequency=top_frequency(stand),
        )
    else:
        drawn = BATTERY[signal](time[moves], lower=-room, upper=room, rng=rng)
        # Without corners, which would take all that the drives can make.
        rows = max(1, round(_ROUND / float(time[1] - time[0])))
        for _ in range(2):
            drawn = uniform_filter1d(drawn, rows, axis=0, mode="nearest")
    both = np.concatenate([path.shift, path.turn], axis=1)
    both[np.ix_(moves, axes)] = drawn
    return replace(path, shift=both[:, :3], turn=both[:, 3:])


def _margins(stand: Stand) -> FloatArray:
    """(2,) how far the centre of mass can go along x and y, to the nearer edge [m].

    Raises:
        OutOfReachError: it is over the edge already.
    """
    area, steps = stand.area(), np.linspace(0.0, 2.0, 801)
    found = []
    for axis in np.eye(2):
        both = [area.margin(stand.centre + way * steps[:, None] * axis) for way in (-1, 1)]
        found.append(min(float(steps[np.argmin(one > 0)]) for one in both))
    if min(found) <= 0:
        raise OutOfReachError("its centre of mass is not over the area that its feet span")
    return np.array(found)


def _lean(stand: Stand, sole: int) -> FloatArray:
    """(2,) by how much the base has to move so that the other soles carry the robot [m].

    Raises:
        OutOfReachError: they span no area, or one that the legs do not reach.
    """
    area = stand.area(without=sole)
    if len(stand.soles) < 2 or area.depth < _LEAST_DEPTH:
        raise OutOfReachError(
            f"without {stand.soles[sole].name} its feet span no area, or one of less than "
            f"{1e3 * _LEAST_DEPTH:.0f} mm from its middle to its edge"
        )
    way = area.centre - stand.centre
    steps = np.linspace(0.0, 1.0, 101)
    margins = area.margin(stand.centre + steps[:, None] * way)
    best = int(np.argmax(margins >= min(_DEEP * area.depth, float(margins.max()))))
    goal = stand.centre + float(steps[best]) * way
    reach, lean = Reach(stand), np.zeros(2)
    for _ in range(4):  # legs and arms do not move as far as the base
        shift = np.zeros((1, 3))
        shift[0, :2] = lean
        qpos = reach.poses(shift, np.zeros((1, 3)), np.zeros((1, len(stand.soles))))[0]
        data: mujoco.MjData = stand.at(qpos)
        lean = lean + goal - data.subtree_com[stand.base.id, :2]
    return lean


def _smooth(part: FloatArray) -> FloatArray:
    """From 0 to 1 without a jump in speed or acceleration."""
    part = np.clip(part, 0.0, 1.0)
    smooth: FloatArray = part**3 * (10 - 15 * part + 6 * part**2)
    return smooth


def _ends(time: FloatArray) -> FloatArray:
    """0 at rest at both ends, 1 in between."""
    ends: FloatArray = _smooth(time - STILL) * _smooth(time[-1] - STILL - time)
    return ends
