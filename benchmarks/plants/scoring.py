"""What counts as right of planted errors; pure functions of outcomes.

Plants that do not show are not asked about, and count nowhere. Effects that are exactly equivalent
on the robot and its signals count as one name, as in `hidden.scoring`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from benchmarks.hidden.cases import ORDINARY
from benchmarks.hidden.outcome import Named
from benchmarks.hidden.scoring import CONFIDENT, aside, same, truth_in_set
from benchmarks.plants.cases import CONTROL, SERVO_GAINS
from benchmarks.plants.outcome import PlantedOutcome
from walkerkit.gap.effects import CATALOGUE

SURE_ENOUGH = 0.7
"""How sure at least half of the right names should be."""
_GEOMETRY = ("payload", "com_offset", "foot_offset", "base_tilt")
_UNASKED = ("impossible", "silent")  # verdicts of what nobody was asked about
_STANDARD_ERRORS = 2.0


def told(outcomes: Sequence[PlantedOutcome], half: str | None = None) -> list[PlantedOutcome]:
    """The plants that show, of one half or of both."""
    return [
        one
        for one in outcomes
        if one.half
        and half in (None, one.half)
        and one.outcome.verdict not in _UNASKED
        and one.shows
    ]


def first_in_set(one: PlantedOutcome) -> bool:
    """Whether the first name is right, or the right one is in its confusion set."""
    return truth_in_set(one.outcome)


def rare_first(one: PlantedOutcome) -> bool:
    """As `first_in_set`, where ordinary names come before no other that is hidden."""
    if any(hidden.effect in ORDINARY for hidden in one.outcome.hidden):
        return first_in_set(one)
    return truth_in_set(aside(one.outcome, ORDINARY))


def first_beside(one: PlantedOutcome, known: Collection[str]) -> bool:
    """As `first_in_set`, of the names that the log is not given with nothing planted.

    Args:
        one: a plant that shows.
        known: as `sure` has it.
    """
    return truth_in_set(aside(one.outcome, known))


def sizes_right(one: PlantedOutcome) -> bool | None:
    """Whether the first name's numbers are within two standard errors of what was planted.

    Returns:
        None where the first name is another one, or has no number to hold against the truth. A
        number at its bound, or without a standard error, is not right.
    """
    named, hidden = one.outcome.named, one.outcome.hidden
    if not named or named[0].effect != hidden[0].effect or named[0].effect not in CATALOGUE:
        return None
    values = named[0].values
    return bool(values) and all(
        value.std is not None and abs(value.value - value.true) <= _STANDARD_ERRORS * value.std
        for value in values
    )


def sure(one: PlantedOutcome, known: Collection[str]) -> list[bool]:
    """Of the names that are stated for sure, whether each is right.

    Args:
        one: a plant that shows.
        known: names that the log is given with nothing planted; whether these are right nobody
            knows, and they are left out.
    """
    return [
        any(same(hidden, named) for hidden in one.outcome.hidden)
        for named in one.outcome.named
        if named.confidence >= CONFIDENT and (named.effect not in known or _is_hidden(one, named))
    ]


def own_names(outcomes: Sequence[PlantedOutcome]) -> dict[str, frozenset[str]]:
    """Log to the names that its best model is given with nothing planted."""
    return {
        one.log: frozenset(named.effect for named in one.outcome.named)
        for one in outcomes
        if one.kind == CONTROL
    }


def gain_first(one: PlantedOutcome) -> bool:
    """Whether the first name is `position_gain`, or exactly equivalent."""
    named = one.outcome.named
    return bool(named) and same(one.outcome.hidden[0], named[0])


def geometry_first(one: PlantedOutcome) -> bool:
    """Whether the first name is of a mass or of where something is."""
    named = one.outcome.named
    return bool(named) and named[0].effect in _GEOMETRY


def of_gains(outcomes: Sequence[PlantedOutcome]) -> list[PlantedOutcome]:
    """The plants that show whose servo's gain nobody knew."""
    return [one for one in told(outcomes) if one.kind in SERVO_GAINS]


def answers(
    some: Sequence[PlantedOutcome], of: Callable[[PlantedOutcome], bool | None]
) -> list[bool]:
    """The answers of some outcomes that have one."""
    return [answer for one in some if (answer := of(one)) is not None]


def _is_hidden(one: PlantedOutcome, named: Named) -> bool:
    return any(same(hidden, named) for hidden in one.outcome.hidden)
