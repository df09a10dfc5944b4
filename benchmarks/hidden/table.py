"""From outcomes to the rows of the table, each with what is required of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from benchmarks import Row
from benchmarks.hidden.outcome import Outcome
from benchmarks.hidden.scoring import (
    CONFIDENT,
    admits,
    all_in_sets,
    all_named,
    confidently_wrong,
    covered,
    false_alarm,
    first_right,
    place_right,
    rare_and_wrong,
    rare_first,
    rare_place,
    ratios,
    set_size,
    share,
    stated,
    truth_in_set,
    unfounded,
    unfounded_alarm,
)

_LARGEST_SET = 5
_ALL_CHANNELS = ("one_effect", "two_effects", "one_of_twelve", "standing", "trotting")


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """The table of some outcomes; tiers of which there are none are left out.

    Args:
        outcomes: of any tiers, in any order.

    Returns:
        A row for each figure, with its number of cases and what is required.
    """
    impossible = [o for o in outcomes if o.verdict == "impossible"]
    outcomes = [o for o in outcomes if o.verdict != "impossible"]
    of_tier = {tier: [o for o in outcomes if o.tier == tier] for tier in _FIGURES}
    table: list[Row] = []
    for tier, figures in _FIGURES.items():
        some = of_tier[tier]
        if some:
            table += [
                _rate(f"{tier}: {what}", [answer(o) for o in some], required)
                for what, answer, required in figures
            ]
        if some and tier == "one_effect_q_qd":
            sizes = [set_size(o) for o in some]
            table.append(
                Row(
                    what=f"{tier}: size of the confusion set, median and largest",
                    result=f"{np.median(sizes):g}, {max(sizes)}",
                    reference=f"at most 2, {_LARGEST_SET}",
                )
            )
    known = ratios(o for o in outcomes if o.tier in _ALL_CHANNELS)
    table += _ratio("all channels", known, 1.1)
    table += _ratio(
        "q, or q and q̇", ratios(o for o in outcomes if o.tier.startswith("one_effect_q")), 1.3
    )
    inside = covered(outcomes)
    if inside:
        table.append(_rate("stated 95 % intervals that hold the truth", inside, "90 to 98 %"))
    sure = stated(outcomes)
    if sure:
        table.append(_rate(f"right of the names given with {CONFIDENT} or more", sure, "90 %"))
    if impossible:
        names = ", ".join(o.case for o in impossible)
        table.append(Row(what="cases where nothing of the hidden shows", result=names))
    failed = [o for o in outcomes if o.verdict == "failed"]
    if failed:
        table.append(Row(what="cases that raised an error", result=str(len(failed)), reference="0"))
    if outcomes:
        seconds = [o.seconds for o in outcomes]
        took = f"{np.median(seconds):.0f} s, {max(seconds):.0f} s"
        table.append(Row(what="seconds a case, median and largest", result=took))
    return table


def line(outcome: Outcome) -> str:
    """One line for people about a case."""
    hidden = "; ".join(one.text for one in outcome.hidden) or "nothing"
    named = "; ".join(
        f"{one.effect}{''.join(f' or {other}' for other in one.doubt)} "
        f"[{one.confidence:.2f}] at {', '.join(one.places) or 'all'}"
        for one in outcome.named
    )
    told = "" if outcome.oracle is None else f", told {outcome.oracle:.3g}"
    return (
        f"{outcome.case} {outcome.seconds:5.0f} s  {_mark(outcome):8} hidden {hidden}"
        f"{f' ({outcome.off} off)' if outcome.off else ''}: {outcome.verdict}, named "
        f"{named or 'nothing'}; gap {outcome.before:.3g} to {outcome.after:.3g}{told}"
        f"{f'; {outcome.error}' if outcome.error else ''}"
    )


def _mark(outcome: Outcome) -> str:
    if outcome.verdict in ("failed", "impossible"):
        return "-"
    if outcome.tier in ("nothing", "nothing_on_feet"):
        return "ALARM" if false_alarm(outcome) else "right"
    if outcome.tier in ("cluttered", "trotting", "trotting_imu"):
        if rare_first(outcome) and not rare_and_wrong(outcome):
            return "right" if rare_place(outcome) else "place"
        return "WRONG"
    if outcome.tier == "outside":
        return "WRONG" if confidently_wrong(outcome) else "right" if admits(outcome) else "silent"
    if all_named(outcome):
        return "right" if place_right(outcome) else "place"
    return "in doubt" if all_in_sets(outcome) else "WRONG"


def _rate(what: str, answers: Sequence[bool], required: str) -> Row:
    return Row(
        what=what,
        result=f"{share(answers):.0%} ({sum(answers)} of {len(answers)})",
        reference=required,
    )


def _ratio(channels: str, found: Iterable[float], most: float) -> list[Row]:
    values = np.array(list(found))
    if not values.size:
        return []
    return [
        Row(
            what=f"held-out gap over that of a fit told the structure, {channels}: "
            "median, nine in ten below",
            result=f"{np.median(values):.2f}, {np.quantile(values, 0.9):.2f} ({values.size})",
            reference=f"at most {most}",
        )
    ]


_Figure = tuple[str, Callable[[Outcome], bool], str]
_ONE: tuple[_Figure, ...] = (
    ("first name right", first_right, "95 %"),
    ("right joint or body", place_right, "97 %"),
    ("truth in the confusion set", truth_in_set, "99 %"),
)
_FIGURES: dict[str, tuple[_Figure, ...]] = {
    "one_effect": _ONE,
    "one_effect_q_qd": (
        ("truth in the confusion set", truth_in_set, "95 %"),
        ("first name right", first_right, ""),
        ("right joint or body", place_right, ""),
    ),
    "one_effect_q": (
        ("truth in the confusion set", truth_in_set, ""),
        ("first name right", first_right, ""),
        ("right joint or body", place_right, ""),
    ),
    "two_effects": (
        ("both named", all_named, "75 %"),
        ("both in the confusion sets", all_in_sets, "85 %"),
    ),
    "nothing": (
        ("false alarm", false_alarm, "at most 2 %"),
        ("of more than bristles, which the hardware has", unfounded_alarm, ""),
    ),
    "outside": (
        ("unexplained or partly explained", admits, "80 %"),
        ("confident wrong name", confidently_wrong, "at most 5 %"),
        ("but for bristles, which the hardware has", unfounded, ""),
    ),
    "one_of_twelve": (
        ("right joint", place_right, "95 %"),
        ("first name right", first_right, "85 %"),
    ),
    "standing": (
        ("first name right", first_right, "90 %"),
        ("right joint or body", place_right, "95 %"),
    ),
    "standing_imu": (
        ("first name right", first_right, "80 %"),
        ("truth in the confusion set", truth_in_set, "90 %"),
    ),
    "trotting": (
        ("first name but the ground's right", rare_first, "80 %"),
        ("right joint or body", rare_place, "90 %"),
    ),
    "trotting_imu": (("first name but the ground's right", rare_first, "70 %"),),
    "nothing_on_feet": (("false alarm", false_alarm, "at most 3 %"),),
    "cluttered": (
        ("first of the names that are not ordinary right", rare_first, "85 %"),
        ("its joint or body", rare_place, "90 %"),
        ("another stated for sure that is not ordinary", rare_and_wrong, "at most 3 %"),
    ),
}
