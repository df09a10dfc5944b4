"""A battery of experiments: position targets that make missing effects show themselves.

    import numpy as np
    from walkerkit.tasks.excitation import BATTERY

    time = np.arange(0.0, 12.0, 0.002)
    rng = np.random.default_rng(0)
    targets = BATTERY["slow_triangle"](time, lower=lower, upper=upper, rng=rng, max_velocity=5.0)

Every signal is a pure function of its arguments: the same generator state gives the same targets.
It stays inside [lower, upper], which it takes for all the room there is; it starts and ends at the
middle of the room, at rest; its joints move out of phase with each other, so that one joint's
share of the motion can be told from its neighbours'. `max_velocity` bounds the targets' slope from
one sample to the next; without it the fast signals use the whole room at any frequency, which few
robots survive.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from walkerkit.tasks.room import Array, Room


class Signal(Protocol):
    """Position targets of all joints over time."""

    def __call__(
        self,
        time: ArrayLike,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
        rng: np.random.Generator,
        max_velocity: ArrayLike | None = None,
    ) -> Array:
        """Returns targets, shape (T, n_joints), rad (m for slide joints).

        Args:
            time: sample times, shape (T,), s, increasing.
            lower: lowest target of each joint, shape (n_joints,), rad.
            upper: highest target of each joint, shape (n_joints,), rad.
            rng: source of the phases and levels.
            max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.

        Raises:
            ValueError: for times that do not increase, a joint with no room between its limits, or
                a bound that is not positive.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """A signal with its name and its purpose.

    Attributes:
        name: the signal's name, the key in `BATTERY`.
        description: one line: what it tells apart.
        signal: the function that makes the targets.
    """

    name: str
    description: str
    signal: Signal

    def __call__(
        self,
        time: ArrayLike,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
        rng: np.random.Generator,
        max_velocity: ArrayLike | None = None,
    ) -> Array:
        """Returns the signal's targets, shape (T, n_joints); arguments as in `Signal`."""
        return self.signal(time, lower=lower, upper=upper, rng=rng, max_velocity=max_velocity)


def chirp(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    start_frequency: float = 0.1,
    end_frequency: float = 8.0,
) -> Array:
    """A sine whose frequency rises exponentially, so that every octave takes the same time.

    Where the room would ask for more than `max_velocity`, the amplitude falls with the frequency.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the phases.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        start_frequency: frequency at the first sample, Hz.
        end_frequency: frequency at the last sample, Hz.

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, or frequencies that do not rise from above 0.
    """
    room = Room(time, lower, upper, max_velocity)
    _require_rising("start_frequency", start_frequency, "end_frequency", end_frequency)
    rate = np.log(end_frequency / start_frequency) / room.duration
    frequency = start_frequency * np.exp(rate * room.time)[:, None]
    cycles = (frequency - start_frequency) / rate
    shape = np.sin(2 * np.pi * (cycles + room.phases(rng)))
    if room.max_velocity is not None:
        shape *= np.minimum(1.0, room.max_velocity / (2 * np.pi * frequency * room.half))
    return room.fill(room.envelope() * shape)


def multisine(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    lowest_frequency: float = 0.1,
    highest_frequency: float = 8.0,
    tones: int = 12,
) -> Array:
    """A sum of sines of equal speed, spread evenly over the octaves; no two joints share a tone.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the phases.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        lowest_frequency: every tone is at or above it, Hz.
        highest_frequency: every tone is below it, Hz.
        tones: number of sines of each joint.

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, frequencies that do not rise from above 0, or no
            tones.
    """
    room = Room(time, lower, upper, max_velocity)
    _require_rising("lowest_frequency", lowest_frequency, "highest_frequency", highest_frequency)
    if tones < 1:
        raise ValueError(f"tones is {tones}; a multisine needs at least 1")
    ratio = highest_frequency / lowest_frequency
    place = (np.arange(tones)[:, None] + np.arange(room.joints) / room.joints) / tones
    frequency = lowest_frequency * ratio**place
    phase = rng.uniform(0.0, 2 * np.pi, frequency.shape)
    angle = 2 * np.pi * frequency * room.time[:, None, None] + phase
    shape = room.envelope() * np.sum(np.sin(angle) / frequency, axis=1)
    return room.fill(shape / np.max(np.abs(shape), axis=0))


def slow_triangle(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    period: float = 6.0,
) -> Array:
    """A constant slow speed to and fro: gravity and friction without inertia.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the phases.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        period: time of one stroke to and fro, s.

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, or a period that is not positive.
    """
    room = Room(time, lower, upper, max_velocity)
    _require_positive("period", period)
    shape = _triangle(room.time[:, None] / period + room.phases(rng))
    return room.fill(room.envelope() * shape)


def steps(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    hold: float = 1.0,
    smallest: float = 0.2,
) -> Array:
    """Jumps of many sizes from side to side of the middle, each joint at its own times.

    With `max_velocity` the jumps become ramps of that slope.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the levels and of the joints' order.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        hold: time from one jump to the next, s; less where the recording has no room for three.
        smallest: smallest distance of a level from the middle, as a share of half the room, in
            [0, 1].

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, a hold that is not positive, or a smallest level
            outside [0, 1].
    """
    room = Room(time, lower, upper, max_velocity)
    _require_positive("hold", hold)
    if not 0 <= smallest <= 1:
        raise ValueError(f"smallest is {smallest}; it is a share of half the room, in [0, 1]")
    hold = min(hold, room.duration / 4)
    count = int(room.duration / hold + 1e-9)
    sizes = np.tile(np.linspace(smallest, 1.0, count - 2)[:, None], room.joints)
    sides = (-1.0) ** np.arange(count - 2)[:, None] * rng.choice([-1.0, 1.0], room.joints)
    level = np.zeros((count, room.joints))
    level[1:-1] = sides * rng.permuted(sizes, axis=0)
    # Level k ends when k + shift holds have passed; the last, the middle, lasts for more than one.
    shift = 1.0 - (rng.permutation(room.joints) + 1.0) / (room.joints + 1.0)
    stage = np.floor(room.time[:, None] / hold - shift).astype(int) + 1
    targets = np.take_along_axis(level, np.clip(stage, 0, count - 1), axis=0)
    return room.fill(targets, ramp=True)


def fast_sine(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    frequency: float = 5.0,
    share: float = 0.3,
) -> Array:
    """A small quick sine about the middle: inertia and delays without gravity's changes.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the phases.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        frequency: of every joint, Hz.
        share: amplitude as a share of half the room, in (0, 1].

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, a frequency that is not positive, or a share
            outside (0, 1].
    """
    room = Room(time, lower, upper, max_velocity)
    _require_positive("frequency", frequency)
    _require_share(share)
    angle = 2 * np.pi * (frequency * room.time[:, None] + room.phases(rng))
    return room.fill(room.envelope() * share * np.sin(angle))


def micro_sine_on_ramp(
    time: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rng: np.random.Generator,
    max_velocity: ArrayLike | None = None,
    frequency: float = 3.0,
    share: float = 0.05,
    period: float = 12.0,
) -> Array:
    """A tiny sine riding on a slow triangle: velocity reversals everywhere in the room.

    Args:
        time: sample times, shape (T,), s, increasing.
        lower: lowest target of each joint, shape (n_joints,), rad.
        upper: highest target of each joint, shape (n_joints,), rad.
        rng: source of the phases.
        max_velocity: bound of the targets' slope, scalar or shape (n_joints,), rad/s.
        frequency: of the tiny sine, Hz.
        share: amplitude of the tiny sine as a share of half the room, in (0, 1].
        period: time of one stroke of the triangle to and fro, s.

    Returns:
        Targets, shape (T, n_joints), rad.

    Raises:
        ValueError: for unusable times or limits, a frequency or period that is not positive, or a
            share outside (0, 1].
    """
    room = Room(time, lower, upper, max_velocity)
    _require_positive("frequency", frequency)
    _require_positive("period", period)
    _require_share(share)
    ramp = _triangle(room.time[:, None] / period + room.phases(rng))
    micro = np.sin(2 * np.pi * (frequency * room.time[:, None] + room.phases(rng)))
    return room.fill(room.envelope() * ((1 - share) * ramp + share * micro))


BATTERY: Final[Mapping[str, Excitation]] = MappingProxyType(
    {
        excitation.name: excitation
        for excitation in (
            Excitation(
                name="chirp",
                description="phase and amplitude over frequency: delay, lag, inertia, viscosity",
                signal=chirp,
            ),
            Excitation(
                name="multisine",
                description="all frequencies at once at all poses: the all-rounder to hold out",
                signal=multisine,
            ),
            Excitation(
                name="slow_triangle",
                description="slow constant speed: Coulomb friction vs backlash, gravity vs offsets",
                signal=slow_triangle,
            ),
            Excitation(
                name="steps",
                description="jumps of many sizes: setpoint filter vs slew vs delay, effort limits",
                signal=steps,
            ),
            Excitation(
                name="fast_sine",
                description="quick and small about one pose: delay vs armature vs velocity gain",
                signal=fast_sine,
            ),
            Excitation(
                name="micro_sine_on_ramp",
                description="tiny reversals at all poses: stiction vs backlash vs cogging",
                signal=micro_sine_on_ramp,
            ),
        )
    }
)
"""The signals by name, each with what it tells apart."""


def _triangle(cycles: Array) -> Array:
    """A triangle wave in [-1, 1] of period 1, zero and rising at 0."""
    triangle: Array = 1.0 - 4.0 * np.abs((cycles + 0.25) % 1.0 - 0.5)
    return triangle


def _require_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} is {value}; it must be positive")


def _require_rising(low_name: str, low: float, high_name: str, high: float) -> None:
    if not (0 < low < high and np.isfinite(high)):
        raise ValueError(f"{low_name} {low} Hz must lie above 0 and below {high_name} {high} Hz")


def _require_share(share: float) -> None:
    if not 0 < share <= 1:
        raise ValueError(f"share is {share}; it is a share of half the room, in (0, 1]")
