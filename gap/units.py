"""Whether the columns of a joint are in one unit, by what they say of each other.

    recording = with_checked_extent(robot, recording)      # how far a joint goes
    recording = with_checked_angles(robot, recording)      # positions and their targets
    recording = with_checked_velocities(robot, recording)  # velocities and slopes of positions

A column in degrees beside one in radians is refused, as is a velocity in degrees per second or in
revolutions, and the message has the factor. What may be something else, as a servo that hardly
follows or a velocity of the motor before its gear, is told in the recording's notes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, refusal
from walkerkit.gap.recordings.checks import source, without
from walkerkit.gap.recordings.recording import LONGEST_STEP, Recording
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.simulation.untaken import before_gear
from walkerkit.gap.too_large import looks_like
from walkerkit.gap.velocities import averaged, disagreement, held_ripple, rates

FloatArray = NDArray[np.float64]

LARGEST_POSITION = 50.0
"""A position beyond this is taken for degrees or millimetres, unless it may be so far [rad; m]."""

_TURN = float(2 * np.pi)
_DEGREE = _TURN / 360
_BEYOND, _FAR_BEYOND = 1.2, 4.0  # of a joint's range, where nothing is as far
_AS_FAR = 0.1  # of a position that is too far, from which its target is in the same unit
_NEVER_SENT = 10.0  # of a joint's range, that none is asked for, be it as weak
_ALIKE, _CLOSE = 0.9, 1.4  # correlation, and times a factor, of columns that differ in unit
_LESS_ALIKE = 0.7  # where one of them is far beyond the range
_SLOW, _WEAK = 2.0, 6.0  # times, that many servos and the weakest fall short of their targets
_GOES_ON = 0.4  # of its size, that a motion changes by from sample to sample
_AGREES = 0.25  # of its size, that a column may differ from the other one
_LEAST_SPAN = 0.02  # rad, of a target that moves
_LONGEST_LAG, _LAGS = 0.3, 16  # s of a position behind its target; how many of them are tried
_MOST_ROWS = 20_000  # that are looked at
_ONE_WAY, _PLACES = 0.9, 200  # of the way of a wheel that winds up, between that many places

_AVERAGED = 0.1  # s, over which velocities are compared
_LONGEST_FILTER = 0.05  # s, that a velocity is behind
_NEAR = 1.2  # times a unit's factor
_NEARER = 1.02  # times that of revolutions, which gears come near to
_EACH_ROW = 0.5  # of the rows that have a target of their own
_RIPPLE, _NO_FACTOR = 2.0, 0.01  # times the ripple of the model; and besides
_ODD = 3.0  # times, that no filter makes a velocity larger or smaller
_FACTORS: Mapping[float, tuple[str, str]] = {
    1 / _DEGREE: ("velocity", "degrees per second; multiply it by pi/180 (numpy.deg2rad)"),
    60 / _TURN: ("velocity", "revolutions per minute; multiply it by pi/30"),
    1 / _TURN: ("velocity", "revolutions per second; multiply it by 2 pi"),
    _TURN / 60: ("velocity", "rpm that were converted twice; multiply it by 30/pi"),
    _TURN: ("position", "revolutions; multiply it and its target by 2 pi"),
    _DEGREE: (
        "position",
        "degrees; multiply it and its target by pi/180 (numpy.deg2rad), or the velocity by 180/pi "
        "where that was converted twice",
    ),
}
"""Of a logged velocity over the slope of the position: the column to blame, and what it is."""


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """How one signal goes with another.

    Attributes:
        ratio: what it changes by where the other changes by one.
        alike: their correlation at the delay at which it is strongest, -1 to 1.
    """

    ratio: float
    alike: float

    def within(self, lower: float, upper: float, *, alike: float = _ALIKE) -> bool:
        """Whether the ratio or its negative is in a range, and the correlation is as strong."""
        return abs(self.alike) >= alike and lower <= abs(self.ratio) <= upper


@dataclass(frozen=True, kw_only=True)
class _Angles:
    """What is logged of where a hinge is and should be.

    Attributes:
        position, target: (T,) samples.
        lower, upper: the joint's range [rad], infinite where it has none.
        likeness: of the position with its target, of how it moves.
    """

    position: FloatArray
    target: FloatArray
    lower: float
    upper: float
    likeness: Likeness

    def in_degrees(self) -> Literal["position", "position_target"] | None:
        """Which of them is in degrees beside the other in radians, or neither."""
        if self._position_is():
            return "position"
        return "position_target" if self._target_is() else None

    @property
    def alike(self) -> bool:
        """Whether neither is an angle of the joint, and they go about as far."""
        both = self.position, self.target
        return all(map(self._no_angle, both)) and all(
            0 < max(sizes) <= _WEAK * min(sizes)
            for sizes in ([float(np.ptp(one)) for one in both], [_peak(one) for one in both])
        )

    @property
    def hardly_follows(self) -> bool:
        """Whether it moves as it would if its target were in degrees; a weak servo may, too."""
        return self.likeness.within(_DEGREE / _WEAK, _DEGREE * _CLOSE)

    def _position_is(self) -> bool:
        least, most = 1 / _DEGREE / _WEAK, 1 / _DEGREE * _CLOSE
        moves = self.likeness.within
        if moves(1 / _DEGREE / _CLOSE, most):
            return True
        if moves(least, most) and self._no_angle(self.position):
            return True
        return self._far_out(self.position, _FAR_BEYOND) and (
            # Nothing turns so far, wherever its encoder has its zero.
            (np.ptp(self.position) > _FAR_BEYOND * (self.upper - self.lower) and self._moves)
            or moves(least, most, alike=_LESS_ALIKE)
            or _agrees(self.position, self.target)
        )

    def _target_is(self) -> bool:
        most, moves = _DEGREE * _CLOSE, self.likeness.within
        if moves(_DEGREE / _SLOW, most) and self._no_angle(self.target):
            return True
        return (
            self._far_out(self.target, _NEVER_SENT)
            and moves(_DEGREE / _WEAK, most, alike=_LESS_ALIKE)
        ) or (self._far_out(self.target, _FAR_BEYOND) and _agrees(self.target, self.position))

    @property
    def _moves(self) -> bool:
        """Whether positions go on from sample to sample, unlike noise."""
        return float(np.std(np.diff(self.position))) < _GOES_ON * float(np.std(self.position))

    def _far_out(self, values: FloatArray, times: float) -> bool:
        return _far_out(values, self.lower, self.upper, times)

    def _no_angle(self, values: FloatArray) -> bool:
        """Whether it is hardly an angle of the joint [rad]."""
        reach = _reach(self.lower, self.upper)
        return bool(np.ptp(values) > _TURN) if np.isinf(reach) else _peak(values) > _BEYOND * reach


def with_checked_extent(robot: Robot, recording: Recording) -> Recording:
    """The recording, with a note of each wheel that turns on and on.

    Args:
        robot: the robot; joints that it lacks are left alone.
        recording: as it was logged; angles that wrap may do so for any number of turns.

    Raises:
        InputError: a joint goes too far, unless its range allows it, or a hinge without one turns
            as its velocity says, or on in one direction where there is no velocity.
    """
    notes = []
    for name, joint in robot.joints.items():
        for signal in ("position", "position_target"):
            values = recording.signal(name, signal)
            if values is None or _peak(values) <= LARGEST_POSITION:
                continue
            if _peak(values) > _farthest(robot, joint, recording):
                raise _refused(recording, _too_far(robot, joint, recording, signal))
            if np.isinf(_range(robot, joint)[1]):
                notes.append(
                    f"{name}/{signal} goes as far as {_peak(values):.4g}, which was taken for "
                    f"{_peak(values) / _TURN:.0f} turns of a wheel; if it is in degrees, multiply "
                    "the joint's columns by pi/180"
                )
    return _with_notes(recording, notes)


def with_checked_angles(robot: Robot, recording: Recording) -> Recording:
    """The recording, with a note of each target that may be in degrees.

    Columns are in degrees where they are far beyond the joint's range and would be within it as
    degrees; a single one, where the other bears that out or it moves with the other and 57.3 times
    as far, with a range or without. Where one of them is and both go about as far, both are.

    Args:
        robot: the robot; joints that it lacks are left alone.
        recording: as it was logged.

    Raises:
        InputError: a position, a target or both are in degrees, or a target is that of a motor in
            front of its gear.
    """
    notes = []
    for name, joint in robot.joints.items():
        position = recording.signal(name, "position")
        target = recording.signal(name, "position_target")
        if joint.slide or position is None:
            continue
        lower, upper = _range(robot, joint)
        logged = [position] if target is None else [position, target]
        where = f"the joint of {robot.source} ends at {_reach(lower, upper):.4g} rad"
        if all(_far_out(values, lower, upper, _FAR_BEYOND) for values in logged):
            raise _refused(recording, _all_of(name, logged, where, lower, upper))
        if target is None:
            continue
        likeness = _likeness(target, position, recording.rate)
        angles = _Angles(
            position=position, target=target, lower=lower, upper=upper, likeness=likeness
        )
        wrong = angles.in_degrees()
        if wrong is not None and angles.alike:
            raise _refused(recording, _all_of(name, logged, where, lower, upper))
        if wrong is not None:
            values = position if wrong == "position" else target
            other = "position_target" if wrong == "position" else "position"
            raise _refused(
                recording,
                f"column '{name}/{wrong}' reaches {_peak(values):.4g}"
                f"{'' if np.isinf(upper) else f', where {where},'} beside a '{name}/{other}' in "
                f"radians: looks like {looks_like([values], lower, upper)}.",
            )
        geared = before_gear(robot, joint, likeness.ratio)
        if geared and abs(likeness.alike) >= _ALIKE:
            raise _refused(recording, geared)
        if angles.hardly_follows:
            notes.append(
                f"{name}/position moves by {abs(likeness.ratio):.2g} of what its target does: the "
                "joint hardly follows, or the target is in degrees and is to be multiplied by "
                "pi/180"
            )
    return _with_notes(recording, notes)


def with_checked_velocities(robot: Robot, recording: Recording) -> Recording:
    """The recording without velocities that are no slopes of their positions, with a note of each.

    Args:
        robot: has the recording's joints.
        recording: positions do not wrap and time has no pause.

    Raises:
        InputError: a velocity is in degrees per second or in revolutions, or a position is in
            degrees beside a velocity in rad/s.
    """
    notes, wrong = [], set[str]()
    for name in recording.joints:
        likeness = velocity_likeness(recording, name)
        if likeness is None or abs(likeness.alike) < _LESS_ALIKE:
            continue
        ratio = f"{abs(likeness.ratio):.3g} times"
        for factor, (column, unit) in _FACTORS.items():
            near = _NEARER if factor == _TURN else _NEAR
            if robot.joints[name].slide or not likeness.within(factor / near, factor * near):
                continue
            raise _refused(
                recording,
                f"column '{name}/velocity' is {ratio} the slope of '{name}/position', so "
                f"'{name}/{column}' looks like {unit}. Leave the velocity out where it is another "
                "one, as of the motor before its gear.",
            )
        found = disagreement(recording, name)
        if found is not None and _is_ripple(robot, recording, name, found.factor):
            found = replace(found, factor=1.0) if found.offset else None
        if found is None and 1 / _ODD < abs(likeness.ratio) < _ODD:
            continue
        slide = robot.joints[name].slide
        notes.append(
            found.sentence(name, "m/s" if slide else "rad/s")
            if found is not None
            else f"{name}/velocity is {ratio} the slope of {name}/position: it is in another unit, "
            "or of the motor before its gear. The velocity is not compared"
        )
        wrong.add(f"{name}/velocity")
    return _with_notes(without(recording, wrong), notes)


def _is_ripple(robot: Robot, recording: Recording, name: str, factor: float) -> bool:
    """Whether a velocity is less than its slope since targets are held from row to row."""
    joint, target = robot.joints[name], recording.signal(name, "position_target")
    both = rates(recording, name)
    if target is None or both is None or np.mean(np.diff(target) != 0) < _EACH_ROW:
        return False
    stiffness = sum(drive.stiffness for drive in joint.drives)
    damping = robot.model.dof_damping[joint.dof] + sum(drive.damping for drive in joint.drives)
    if stiffness <= 0:
        return False
    least, most = held_ripple(
        both[2], inertia=robot.model.dof_M0[joint.dof], stiffness=stiffness, damping=float(damping)
    )
    # The joint may have another inertia than the model.
    return bool(1 + _RIPPLE * (least - 1) - _NO_FACTOR < factor < 1 + _RIPPLE * (most - 1))


def velocity_likeness(recording: Recording, joint: str) -> Likeness | None:
    """How the logged velocity goes with the slope of the logged position.

    Args:
        recording: positions do not wrap and time has no pause.
        joint: one of its joints.

    Returns:
        1 and about 1 for a proper one; None where no velocity is logged or the joint stands.
    """
    both = rates(recording, joint)
    if both is None:
        return None
    *signals, step = both
    slope, logged = (averaged(one, _AVERAGED, step) for one in signals)
    best = Likeness(ratio=0.0, alike=0.0)
    for lag in _lags(_LONGEST_FILTER / step, len(slope)):
        # Not about their means: a wheel at one speed has a velocity, too.
        before, after = slope[: len(slope) - lag], logged[lag:]
        sizes = float(np.linalg.norm(before)), float(np.linalg.norm(after))
        if min(sizes) > 0:
            alike = float(before @ after) / (sizes[0] * sizes[1])
            if abs(alike) > abs(best.alike):
                best = Likeness(ratio=float(np.sign(alike)) * sizes[1] / sizes[0], alike=alike)
    return best


def _all_of(
    joint: str, logged: Sequence[FloatArray], where: str, lower: float, upper: float
) -> str:
    """What to say of a position, and its target if that is logged, that are no radians."""
    reaches = f"column '{joint}/position' reaches {_peak(logged[0]):.4g}"
    wrong = looks_like(logged, lower, upper)
    if len(logged) == 1:
        return f"{reaches}, where {where}: looks like {wrong}."
    return (
        f"{reaches} and '{joint}/position_target' {_peak(logged[1]):.4g}, where {where}: both look "
        f"like {wrong}. The same holds for all others that are in that unit."
    )


def _likeness(target: FloatArray, position: FloatArray, rate: float) -> Likeness:
    """How a position goes with its target, with which it may be late and off by a constant."""
    best = Likeness(ratio=0.0, alike=0.0)
    if np.ptp(target) < _LEAST_SPAN or np.ptp(position) == 0:
        return best
    stride = 1 + len(target) // _MOST_ROWS
    for lag in _lags(_LONGEST_LAG * rate, len(target)):
        wanted, done = target[: len(target) - lag : stride], position[lag::stride]
        wanted, done = wanted - wanted.mean(), done - done.mean()
        sizes = float(np.linalg.norm(wanted)), float(np.linalg.norm(done))
        if min(sizes) > 0:
            product = float(wanted @ done)
            alike = product / (sizes[0] * sizes[1])
            if abs(alike) > abs(best.alike):
                best = Likeness(ratio=product / sizes[0] ** 2, alike=alike)
    return best


def _farthest(robot: Robot, joint: Joint, recording: Recording) -> float:
    """How far a joint and its target may be [rad; m]."""
    lower, upper = _range(robot, joint)
    position = recording.signal(joint.name, "position")
    if np.isfinite(upper):
        return max(LARGEST_POSITION, _BEYOND * _reach(lower, upper))
    if joint.slide or position is None or not _turns_on(recording, joint.name):
        return LARGEST_POSITION
    return max(LARGEST_POSITION, _ODD * _peak(position))


def _turns_on(recording: Recording, joint: str) -> bool:
    """Whether a joint turns as its velocity says; on in one direction, where there is none."""
    position = recording.columns[f"{joint}/position"]
    logged = (recording.signal(joint, signal) for signal in ("velocity", "velocity_target"))
    velocities = [velocity for velocity in logged if velocity is not None and velocity.any()]
    if not velocities:
        places = position[:: 1 + len(position) // _PLACES]
        return bool(np.ptp(places) >= _ONE_WAY * np.abs(np.diff(places)).sum())
    steps = np.minimum(np.diff(recording.time), LONGEST_STEP)  # pauses are refused later
    travelled = (np.cumsum(np.append(0.0, 0.5 * (v[1:] + v[:-1]) * steps)) for v in velocities)
    found = [_likeness(way, position, recording.rate) for way in travelled]
    # A velocity that is too large is not the position's fault.
    beyond = any(one.within(_ODD, np.inf) for one in found)
    return any(one.within(0.0, _ODD) for one in found) and not beyond


def _too_far(robot: Robot, joint: Joint, recording: Recording, signal: str) -> str:
    values = recording.columns[f"{joint.name}/{signal}"]
    row = int(np.argmax(np.abs(values) > LARGEST_POSITION))
    # One of them may be in radians.
    far = [v for v in _angles_of(recording, joint.name) if _peak(v) > _AS_FAR * _peak(values)]
    unit, wrong = "rad", looks_like(far, *_range(robot, joint))
    remedy = f"Of a wheel log '{joint.name}/velocity' in rad/s, too, which bears it out."
    if joint.slide:
        unit, wrong = "m", "millimetres; divide it by 1000"
        remedy = f"Where it goes so far, give the joint of {robot.source} a range that says so."
    upper = _reach(*_range(robot, joint))
    if np.isfinite(upper):
        remedy = f"The joint of {robot.source} ends at {upper:.4g} {unit}."
    return (
        f"column '{joint.name}/{signal}' has {values[row]:g} at "
        f"{recording.row(row)}, over {LARGEST_POSITION:g} {unit}: looks like "
        f"{wrong}. {remedy}"
    )


def _angles_of(recording: Recording, joint: str) -> list[FloatArray]:
    """The position of a joint and its target, as far as they are logged."""
    logged = (recording.signal(joint, signal) for signal in ("position", "position_target"))
    return [values for values in logged if values is not None]


def _lags(longest: float, rows: int) -> list[int]:
    """Some numbers of rows, from none to the longest, of which most rows are left."""
    most = min(int(longest), rows // 4)
    return sorted({int(lag) for lag in np.linspace(0, most, _LAGS)})


def _range(robot: Robot, joint: Joint) -> tuple[float, float]:
    if not robot.model.jnt_limited[joint.id]:
        return -np.inf, np.inf
    lower, upper = robot.model.jnt_range[joint.id]
    return float(lower), float(upper)


def _reach(lower: float, upper: float) -> float:
    return max(abs(lower), abs(upper))


def _peak(values: FloatArray) -> float:
    return float(np.abs(values).max())


def _far_out(values: FloatArray, lower: float, upper: float, times: float) -> bool:
    """Whether values are as many times beyond a range, and within it as degrees."""
    reach, peak = _reach(lower, upper), _peak(values)
    return peak > times * reach and _DEGREE * peak <= _BEYOND * reach


def _agrees(values: FloatArray, angles: FloatArray) -> bool:
    """Whether values as degrees are the other's angles, and are not as radians."""
    apart = values - angles
    apart = apart - _TURN * np.rint(apart / _TURN)
    as_degrees, as_radians, size = (
        float(np.sqrt(np.mean(one**2))) for one in (_DEGREE * values - angles, apart, angles)
    )
    return as_degrees < _AGREES * min(size, as_radians)


def _with_notes(recording: Recording, notes: Iterable[str]) -> Recording:
    notes = tuple(notes)
    return replace(recording, notes=(*recording.notes, *notes)) if notes else recording


def _refused(recording: Recording, problem: str) -> InputError:
    return refusal(f"{source(recording)}: {problem}")
