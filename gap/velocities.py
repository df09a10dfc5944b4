"""Whether a logged velocity is the slope of its position, times a factor, or off by a number.

    found = disagreement(recording, "knee")       # None, or what they differ by
    found.sentence("knee")

An encoder behind a gear, a velocity in another unit or an estimate whose zero is off differ by a
constant. What a filter makes depends on how fast the motion is, so that the same has to come out of
its slow part alone; what rounding makes is less than a step of the velocity's digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.ndimage import uniform_filter1d

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.smooth import Smoothed

FloatArray = NDArray[np.float64]

_STILL = 1e-3  # rad or m; a joint that moves less has no velocity to compare
_AVERAGED, _SLOW = 0.1, 0.4  # s, over which velocities are compared
_LONGEST_FILTER = 0.05  # s, that a velocity is behind
_LAGS = 16  # how many of them are tried
_ALIKE = 0.98  # correlation from which a factor is one
_FACTOR, _OFFSET = 0.03, 0.05  # least that matters, the second of the velocity's own size
_LEFT = 0.5  # of what a factor explains, that it leaves
_SAME = 0.02  # by which the factor of the slow part may differ
_SLOW_PART = 0.2  # of the motion, which has to be slow to be compared
_BLOCKS, _CERTAIN = 8, 5.0  # parts of a log, and standard errors


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """What a velocity is of the slope of its position.

    Attributes:
        factor: of the slope [1].
        offset: added to that [rad/s; m/s].
        alike: their correlation.
    """

    factor: float
    offset: float
    alike: float

    def sentence(self, joint: str, unit: str) -> str:
        """What a user should know and do."""
        if self.factor == 1.0:
            what = f"the slope of {joint}/position {self.offset:+.3g} {unit}"
            cause = "its zero is off"
        else:
            what = f"{self.factor:.3g} times the slope of {joint}/position"
            what += f" {self.offset:+.3g} {unit}" if self.offset else ""
            cause = "one of them is in another unit, or of the motor before its gear"
        alike = np.floor(1e4 * self.alike) / 1e4  # never told as 1
        return (
            f"{joint}/velocity is {what}, with a correlation of {alike:.4f}: {cause}. The "
            "velocity is not compared. Mend whichever is wrong; where it is the position, so are "
            "all angles of the joint"
        )


def rates(recording: Recording, joint: str) -> tuple[FloatArray, FloatArray, float] | None:
    """The slope of the logged position and the logged velocity, and the time between samples.

    Args:
        recording: positions do not wrap and time has no pause.
        joint: one of its joints.

    Returns:
        (n,) rad/s each, and s; None where no velocity is logged or the joint stands.
    """
    position, velocity = (recording.signal(joint, s) for s in ("position", "velocity"))
    if position is None or velocity is None or np.ptp(position) < _STILL:
        return None
    smoothed = Smoothed(recording.time, np.stack([position, velocity]))
    return smoothed.slopes[0], smoothed.values[1], smoothed.step


def held_ripple(
    period: float, *, inertia: float, stiffness: float, damping: float
) -> tuple[float, float]:
    """What a servo's velocity is of its slope as each target comes, where these are held between.

    A stiff servo jumps ahead with each target and has slowed down when the next one comes, which is
    when a log has its rows: their velocity is less than the slope, all the time.

    Args:
        period: from target to target [s].
        inertia: of the joint [kg·m²; kg].
        stiffness: of the servo [N·m/rad; N/m].
        damping: of servo and joint [N·m·s/rad; N·s/m].

    Returns:
        The least and the largest factor, 1 among them.
    """
    law = np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])
    # Of motion at a speed of 1, the same in every period: behind the target, and the velocity.
    behind = -np.linalg.solve(np.eye(2) - expm(law * period), [period, 0.0])
    factor = float(behind[1])
    return min(factor, 1.0), max(factor, 1.0)


def averaged(values: FloatArray, seconds: float, step: float) -> FloatArray:
    """Samples averaged over some time, or a quarter of all."""
    rows = max(1, min(round(seconds / step), len(values) // 4))
    smooth: FloatArray = uniform_filter1d(values, rows)
    return smooth


def disagreement(recording: Recording, joint: str) -> Disagreement | None:
    """What a velocity and the slope of its position differ by for certain; None where they agree.

    Args:
        recording: positions do not wrap and time has no pause.
        joint: one of its joints.
    """
    both = rates(recording, joint)
    if both is None:
        return None
    slope, logged, step = both
    quick = averaged(slope, _AVERAGED, step), averaged(logged, _AVERAGED, step)
    lag = _lag(*quick, step)
    s, v = _shifted(*quick, lag)
    if np.std(s) < _SLOW_PART * abs(np.mean(s)):  # a wheel at one speed
        return _of_one_speed(s, v)
    factor, alike = _line(s, v)
    if abs(alike) < _ALIKE or factor <= 0:  # a flipped sign is an error of wiring
        return None
    digit = _digit(recording.columns[f"{joint}/velocity"])
    offset = _offset(s, v)
    offset = offset if abs(offset) > digit else 0.0
    # Noise of the one or of the other draws the factor between these.
    least, most = sorted([factor, factor / alike**2])
    differs = least > 1 + _FACTOR or most < 1 - _FACTOR
    differs = differs and abs(factor - 1) * float(np.std(s)) > digit
    # A constant factor leaves little beside what it explains.
    differs = differs and factor * np.sqrt(1 - alike**2) < _LEFT * abs(factor - 1)
    # A filter of time constant T is behind by T, and takes off (ω T)²/2 of a motion of frequency ω.
    frequency = float(np.std(np.gradient(s, step)) / np.std(s))
    differs = differs and not 0 < 1 - factor < (frequency * lag * step) ** 2
    if differs:
        of_slow = _shifted(averaged(slope, _SLOW, step), averaged(logged, _SLOW, step), lag)
        if np.std(of_slow[0]) < _SLOW_PART * np.std(s):
            return None
        same, how = _line(*of_slow)
        if abs(how) < _ALIKE or abs(same - factor) > _SAME * factor:
            return None
    if not differs and not offset:
        return None
    return Disagreement(factor=factor if differs else 1.0, offset=offset, alike=alike)


def _lag(slope: FloatArray, logged: FloatArray, step: float) -> int:
    """Samples by which the velocity is behind."""
    most = min(int(_LONGEST_FILTER / step), len(slope) // 4)
    lags = sorted({int(lag) for lag in np.linspace(0, most, _LAGS)})
    return max(lags, key=lambda lag: abs(_line(*_shifted(slope, logged, lag))[1]))


def _shifted(slope: FloatArray, logged: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    return slope[: len(slope) - lag], logged[lag:]


def _line(slope: FloatArray, logged: FloatArray) -> tuple[float, float]:
    """Least-squares factor about the means, and the correlation; zeros where one is constant."""
    s, v = slope - slope.mean(), logged - logged.mean()
    sizes = float(np.linalg.norm(s)), float(np.linalg.norm(v))
    if min(sizes) == 0:
        return 0.0, 0.0
    product = float(s @ v)
    return product / sizes[0] ** 2, product / (sizes[0] * sizes[1])


def _offset(slope: FloatArray, logged: FloatArray) -> float:
    """What a velocity is when the joint stands, if that is not zero for certain."""
    factor, _ = _line(slope, logged)
    left = logged - factor * slope
    parts = np.array([part.mean() for part in np.array_split(left, _BLOCKS) if part.size])
    error = float(parts.std(ddof=1)) / np.sqrt(parts.size) if parts.size > 1 else np.inf
    offset = float(left.mean())
    certain = abs(offset) > _CERTAIN * error and abs(offset) > _OFFSET * float(np.std(logged))
    return offset if certain else 0.0


def _digit(velocity: FloatArray) -> float:
    """The least step between the velocities of a log."""
    different = np.unique(velocity)
    return float(np.diff(different).min()) if different.size > 1 else 0.0


def _of_one_speed(slope: FloatArray, logged: FloatArray) -> Disagreement | None:
    """A factor alone, since at one speed an offset looks the same."""
    ratios = np.array(
        [
            v.mean() / s.mean()
            for s, v in zip(
                np.array_split(slope, _BLOCKS), np.array_split(logged, _BLOCKS), strict=True
            )
            if s.size
        ]
    )
    factor, error = float(ratios.mean()), float(ratios.std(ddof=1)) / np.sqrt(ratios.size)
    if factor <= 0 or abs(factor - 1) < max(_FACTOR, _CERTAIN * error):
        return None
    alike = float(slope @ logged) / float(np.linalg.norm(slope) * np.linalg.norm(logged))
    return Disagreement(factor=factor, offset=0.0, alike=alike)
