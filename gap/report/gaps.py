"""How large the gap is, of all joints and of each, of every signal, and where it lives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from walkerkit.gap.report.quantity import percent

_AT_FLOOR = 1.5  # a gap within this factor of noise and numerical error together is none
_JOINT_AT_FLOOR = 2.0  # the same of one joint among others
_MOSTLY = 0.5  # of the way to its floor, which an explained gap has gone


@dataclass(frozen=True, kw_only=True)
class GapSize:
    """Root-mean-square difference between simulation and measurement.

    Attributes:
        unit: unit of the numbers.
        before: with the model as it was given.
        after: with the named effects added.
        noise_floor: what the measurement's own noise leaves, in the log and in the measured states
            from which replays restart.
        numerical_floor: what the simulation's own timestep leaves, and how it rounds off dry
            friction.
        by_chance: how many times its noise floor so few restarts leave by chance, of the noise
            alone.
        numerical_near: of a joint, the largest numerical floor of those that carry it or that it
            carries, itself among them.
    """

    unit: str
    before: float
    after: float
    noise_floor: float
    numerical_floor: float = 0.0
    by_chance: float = 1.0
    numerical_near: float = 0.0

    @property
    def floor(self) -> float:
        """What noise and numerical error leave together."""
        return math.hypot(self.noise_floor, self.numerical_floor)

    @property
    def at_floor(self) -> bool:
        """Whether no gap is left that is worth the word."""
        return self.after <= max(_AT_FLOOR * self.floor, self.by_chance * self.noise_floor)

    @property
    def closed(self) -> float:
        """How much of the way to the floor was gone, as of ratios, 0 to 1; 0 of none."""
        if self.at_floor:
            return 1.0
        if not 0.0 < self.floor < self.before or self.after >= self.before:
            return 0.0
        return math.log(self.before / self.after) / math.log(self.before / self.floor)

    @property
    def mostly_closed(self) -> bool:
        """Whether what is named explains the signal."""
        return self.closed >= _MOSTLY


@dataclass(frozen=True, kw_only=True)
class Gap:
    """The gap of all joints, per joint and per signal, on recordings that no fit has seen.

    Where nothing is named and the held-out recordings show no gap, it is that of the others.

    Attributes:
        position: over all joints.
        horizon: seconds after which replays restart from the measured state, or None for whole
            rollouts.
        finer_position: over all joints at a quarter of the timestep, where that matters more than
            the noise; its numerical floor is what even this timestep leaves.
        finer_joints: joint to the same of it alone.
        joints: joint to its position gap.
        signals: signal to its gap over all joints.
        scored: those that effects are judged by, and have to explain.
        drier: friction that is as dry as it goes comes nearer to these recordings than a finer
            timestep alone, and is part of the numerical floors.
        held_out: whether it is of recordings that no fit has seen.
    """

    position: GapSize
    horizon: float | None
    finer_position: GapSize | None
    joints: Mapping[str, GapSize]
    signals: Mapping[str, GapSize]
    finer_joints: Mapping[str, GapSize] = field(default_factory=dict)
    scored: tuple[str, ...] = ("position",)
    drier: bool = False
    held_out: bool = True

    @property
    def besides(self) -> dict[str, GapSize]:
        """What effects have to explain besides the position."""
        return {name: self.signals[name] for name in self.scored if name != "position"}

    @property
    def grown(self) -> bool:
        """Whether no signal that effects are judged by has a smaller gap with what is named."""
        finer = () if self.finer_position is None else (self.finer_position,)
        return all(s.after >= s.before for s in (self.position, *finer, *self.besides.values()))

    @property
    def position_at_floor(self) -> bool:
        """Whether no joint's position has a gap left, or none has at a quarter of the timestep."""
        if self.position.at_floor and not _standing_out(self.joints):
            return True
        finer = self.finer_position
        return finer is not None and finer.at_floor and not _standing_out(self.finer_joints)

    @property
    def hidden_joints(self) -> tuple[str, ...]:
        """Joints whose gap does not show in that of all, which is at its floor; largest first."""
        at_floor = self.position.at_floor and not self.position_at_floor
        return _standing_out(self.joints) if at_floor else ()


def _standing_out(joints: Mapping[str, GapSize]) -> tuple[str, ...]:
    """Joints whose own gap is far above their own floor, by how far.

    Many others that are at theirs hide it in the gap of all, as does one of another unit. What the
    timestep leaves at one joint is no better known than what it leaves at those that it is moved by
    or moves.
    """
    floors = {n: math.hypot(one.noise_floor, one.numerical_near) for n, one in joints.items()}
    far = {
        n: one.after / floors[n]
        for n, one in joints.items()
        if one.after > max(_JOINT_AT_FLOOR * floors[n], one.by_chance * one.noise_floor)
        and floors[n] > 0
    }
    return tuple(sorted(far, key=lambda n: -far[n]))


@dataclass(frozen=True, kw_only=True)
class Location:
    """Where the gap lives.

    Attributes:
        joint: the joint.
        regime: when, e.g. `velocity_reversal`.
        share: part of the squared gap of all joints that falls there.
        lift: that part over the part of the samples.
        signal: whose gap, `position` or `effort`.
        rms: root-mean-square gap there, in the joint's unit; not in the JSON.
    """

    joint: str
    regime: str
    share: float
    lift: float
    signal: str = "position"
    rms: float = float("nan")

    def __str__(self) -> str:
        return (
            f"{self.joint}, {self.regime}: {percent(self.share)} of the {self.signal} gap, "
            f"lift {self.lift:.2g}"
        )


@dataclass(frozen=True, kw_only=True)
class GapMap:
    """The gap of one signal in every regime of every joint.

    Attributes:
        signal: `position` or `effort`.
        unit: unit of the gaps.
        before, after: its cells with the model as it was given, and as mended.
    """

    signal: str
    unit: str
    before: tuple[Location, ...]
    after: tuple[Location, ...]
