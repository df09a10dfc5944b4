"""What the episodes of a policy say: of each robot, of each effect, of each rival."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.policy.policy_variants import Kind, Variant
from walkerkit.gap.policy.rollout import Episode
from walkerkit.gap.policy.statistics import (
    LEVEL,
    Interval,
    Verdict,
    finding,
    of_mean,
    of_share,
)

FloatArray = NDArray[np.float64]
Measure = Literal["return", "falls", "tracking"]
MEASURES: tuple[Measure, ...] = ("return", "falls", "tracking")


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a policy did on one robot.

    Attributes:
        name: the robot, in words.
        kind, effect, in_place_of: as of `Variant`.
        effects: all that the robot has.
        episodes: one for each seed.
    """

    name: str
    kind: Kind
    effect: str
    in_place_of: str
    effects: tuple[str, ...]
    episodes: tuple[Episode, ...]

    @classmethod
    def of(cls, variant: Variant, episodes: tuple[Episode, ...]) -> Outcome:
        """That of a variant."""
        return cls(
            name=variant.name,
            kind=variant.kind,
            effect=variant.effect,
            in_place_of=variant.in_place_of,
            effects=variant.robot.effects,
            episodes=episodes,
        )

    @property
    def total(self) -> Interval:
        """The return."""
        return of_mean(self.costs("return") * -1.0)

    @property
    def falls(self) -> Interval:
        """The share of episodes that end in a fall."""
        return of_share(sum(one.fell for one in self.episodes), len(self.episodes))

    @property
    def tracking(self) -> Interval | None:
        """The root-mean-square error of what is tracked."""
        if any(one.tracking is None for one in self.episodes):
            return None
        return of_mean(self.costs("tracking"))

    def costs(self, measure: Measure) -> FloatArray:
        """(n_episodes,) what is the worse the larger it is."""
        if measure == "return":
            return np.array([-one.total for one in self.episodes])
        if measure == "falls":
            return np.array([float(one.fell) for one in self.episodes])
        return np.array([np.nan if e.tracking is None else e.tracking for e in self.episodes])

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        tracking = self.tracking
        return {
            "name": self.name,
            "kind": self.kind,
            "effects": list(self.effects),
            "return": self.total.to_dict(),
            "falls": {"count": sum(one.fell for one in self.episodes), **self.falls.to_dict()},
            "tracking": None if tracking is None else tracking.to_dict(),
            "episodes": [vars(one).copy() for one in self.episodes],
        }


@dataclass(frozen=True, kw_only=True)
class Part:
    """What an effect takes from a policy.

    Attributes:
        effect: its name.
        alone: what is lost with it alone.
        regained: what is regained where it alone is taken out of the mended model.
        part: the mean of the two, its part of the loss.
        verdict: whether it breaks the policy.
    """

    effect: str
    alone: Interval
    regained: Interval
    part: Interval
    verdict: Verdict

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        intervals = {n: getattr(self, n).to_dict() for n in ("part", "alone", "regained")}
        return {"effect": self.effect, "verdict": self.verdict, **intervals}


@dataclass(frozen=True, kw_only=True)
class RivalPart:
    """What is lost with a rival in the place of an effect.

    Attributes:
        effect: the rival.
        in_place_of: what it stands for.
        loss: what is lost with all effects, and it instead.
        verdict: whether the policy is broken then.
    """

    effect: str
    in_place_of: str
    loss: Interval
    verdict: Verdict

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {**vars(self), "loss": self.loss.to_dict()}


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What is lost, by what.

    Attributes:
        loss: of the mended model.
        verdict: whether that breaks the policy.
        parts: of each effect, the largest first.
        rivals: of each member of the confusion set that is not named.
        margin: what may be lost, in the measure's own unit.
    """

    loss: Interval
    verdict: Verdict
    parts: tuple[Part, ...]
    rivals: tuple[RivalPart, ...]
    margin: float

    @property
    def hangs_on(self) -> tuple[RivalPart, ...]:
        """The rivals with which the policy is known to fare otherwise."""
        known = {"breaks", "harmless"}
        return tuple(one for one in self.rivals if {one.verdict, self.verdict} == known)


def judged(
    outcomes: Sequence[Outcome], effects: Sequence[str], *, measure: Measure, margin: float
) -> Judgement:
    """Compares the robots, seed by seed.

    An effect's part of the loss is the mean of what it takes when it alone is put in and of what
    is regained when it alone is taken out: of two effects, Shapley's value. Whether that, or any
    other loss, breaks the policy is `finding`'s to say, at a level at which all that is asked
    holds together (Bonferroni).

    Args:
        outcomes: of all robots; the first is as given.
        effects: names of those that were named.
        measure: by what the policy is judged.
        margin: what may be lost, as a share of what it has as given; of falls, of the episodes.
    """
    cost: Mapping[tuple[str, ...], FloatArray] = {
        tuple(sorted(one.effects)): one.costs(measure) for one in outcomes if one.kind != "rival"
    }
    given, mended = cost[()], cost[tuple(sorted(effects))]
    rivals = [one for one in outcomes if one.kind == "rival"]
    level = 1 - (1 - LEVEL) / (1 + len(effects) + len(rivals))
    allowed = margin if measure == "falls" else margin * abs(float(np.mean(given)))
    parts = []
    for name in effects:
        alone = cost[name,] - given
        left = tuple(sorted(other for other in effects if other != name))
        regained = mended - cost[left]
        part = of_mean((alone + regained) / 2, level)
        parts.append(
            Part(
                effect=name,
                alone=of_mean(alone, level),
                regained=of_mean(regained, level),
                part=part,
                verdict=finding(part, allowed),
            )
        )
    loss = of_mean(mended - given, level)
    others = []
    for one in rivals:
        its = of_mean(one.costs(measure) - given, level)
        others.append(
            RivalPart(
                effect=one.effect,
                in_place_of=one.in_place_of,
                loss=its,
                verdict=finding(its, allowed),
            )
        )
    return Judgement(
        loss=loss,
        verdict=finding(loss, allowed),
        parts=tuple(sorted(parts, key=lambda one: -one.part.mean)),
        rivals=tuple(others),
        margin=allowed,
    )
