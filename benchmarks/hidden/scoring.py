"""What counts as right; pure functions of outcomes.

Effects that the catalogue documents as exactly equivalent on the robot and channels of a case count
as one name. A verdict about several effects is right only as a whole.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

from benchmarks.hidden.outcome import Hidden, Named, Outcome

CONFIDENT = 0.9
"""From where on a name is stated for sure."""
BRISTLES = ("presliding_friction",)
"""What the simulated hardware has wherever it rubs, whatever is hidden."""
_Z = 1.96  # standard errors to either side of a 95 % interval


def same(hidden: Hidden, named: Named) -> bool:
    """Whether the name is the hidden effect's, or exactly equivalent to it."""
    return named.effect == hidden.effect or hidden.effect in named.alike


def in_doubt(hidden: Hidden, named: Named) -> bool:
    """Whether the hidden effect is the named one or among those it cannot be told from."""
    names = {named.effect, *named.doubt, *named.alike}
    return hidden.effect in names or not names.isdisjoint(hidden.alike)


def first_right(outcome: Outcome) -> bool:
    """Whether the first name is that of a hidden effect."""
    return bool(outcome.named) and any(same(h, outcome.named[0]) for h in outcome.hidden)


def truth_in_set(outcome: Outcome) -> bool:
    """Whether the first name's confusion set has the hidden effect."""
    return bool(outcome.named) and any(in_doubt(h, outcome.named[0]) for h in outcome.hidden)


def set_size(outcome: Outcome) -> int:
    """How many names the first confusion set has, the first name included; 0 for no name."""
    return 1 + len(outcome.named[0].doubt) if outcome.named else 0


def place_right(outcome: Outcome) -> bool:
    """Whether the first name is at its hidden effect's joints or bodies, and at no others.

    Where the name is another that makes exactly the same logs, such as that of an effect of the
    whole robot for one of a joint, no place is wrong.
    """
    if not outcome.named or not outcome.hidden:
        return False
    found = outcome.named[0]
    truth = next((h for h in outcome.hidden if same(h, found)), outcome.hidden[0])
    if found.effect != truth.effect and same(truth, found):
        return True
    return set(found.places) == set(truth.places)


def aside(outcome: Outcome, names: Collection[str]) -> Outcome:
    """The outcome without some of the names, but for those that are hidden."""
    left = tuple(
        named
        for named in outcome.named
        if named.effect not in names or any(same(h, named) for h in outcome.hidden)
    )
    return replace(outcome, named=left)


def rare_first(outcome: Outcome) -> bool:
    """Whether of the names that are not those of what is beside it the hidden effect is first."""
    return first_right(aside(outcome, outcome.beside))


def rare_place(outcome: Outcome) -> bool:
    """As `place_right`, of the first name that is none of what is beside it."""
    return place_right(aside(outcome, outcome.beside))


def rare_and_wrong(outcome: Outcome) -> bool:
    """Whether a name that is none of what is beside it is stated for sure, and wrong."""
    return confidently_wrong(aside(outcome, outcome.beside))


def all_named(outcome: Outcome) -> bool:
    """Whether every hidden effect is named, each by a name of its own."""
    return _matched(outcome, same)


def all_in_sets(outcome: Outcome) -> bool:
    """Whether every hidden effect is in the confusion set of a name of its own."""
    return _matched(outcome, in_doubt)


def false_alarm(outcome: Outcome) -> bool:
    """Whether an effect is named where there is none."""
    return any(named.effect not in outcome.beside for named in outcome.named)


def unfounded_alarm(outcome: Outcome) -> bool:
    """A false alarm of more than bristles, which the hardware has wherever it rubs."""
    return false_alarm(aside(outcome, BRISTLES))


def admits(outcome: Outcome) -> bool:
    """Whether it is said that something is left unexplained."""
    return outcome.verdict in ("unexplained", "partly_explained")


def confidently_wrong(outcome: Outcome) -> bool:
    """Whether a name is stated for sure that is none of the hidden effects."""
    return any(
        named.confidence >= CONFIDENT and not any(same(h, named) for h in outcome.hidden)
        for named in outcome.named
    )


def unfounded(outcome: Outcome) -> bool:
    """Whether a name but bristles, which the hardware has, is stated for sure, and wrong."""
    return confidently_wrong(aside(outcome, BRISTLES))


def stated(outcomes: Iterable[Outcome]) -> list[bool]:
    """Of all names that are stated for sure, whether each is right; what is beside is no name."""
    return [
        any(same(h, named) for h in outcome.hidden)
        for outcome in outcomes
        for named in outcome.named
        if named.confidence >= CONFIDENT and named.effect not in outcome.beside
    ]


def covered(outcomes: Iterable[Outcome]) -> list[bool]:
    """Of all stated 95 % intervals of rightly named effects, whether each holds the truth."""
    return [
        abs(value.value - value.true) <= _Z * value.std
        for outcome in outcomes
        for named in outcome.named
        for value in named.values
        if value.std is not None
    ]


def ratios(outcomes: Iterable[Outcome]) -> list[float]:
    """Held-out gaps after the diagnosis over those of fits that were told the structure."""
    return [o.after / o.oracle for o in outcomes if o.oracle]


def share(answers: Sequence[bool]) -> float:
    """Part of the answers that are yes; NaN of none."""
    return sum(answers) / len(answers) if answers else float("nan")


def _matched(outcome: Outcome, fits: Callable[[Hidden, Named], bool]) -> bool:
    """Whether the names can be dealt out so that each hidden effect gets one that fits."""
    return any(
        all(fits(h, named) for h, named in zip(outcome.hidden, dealt, strict=True))
        for dealt in itertools.permutations(outcome.named, len(outcome.hidden))
    )
