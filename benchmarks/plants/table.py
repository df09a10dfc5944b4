"""From outcomes of planted errors to the rows of the table, each with what is required of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks import Row
from benchmarks.hidden.scoring import CONFIDENT, place_right, share
from benchmarks.plants.cases import AS_GIVEN
from benchmarks.plants.kinds import SIGN_FLIP
from benchmarks.plants.outcome import PlantedOutcome
from benchmarks.plants.scoring import (
    SURE_ENOUGH,
    answers,
    first_beside,
    first_in_set,
    gain_first,
    geometry_first,
    of_gains,
    own_names,
    rare_first,
    sizes_right,
    sure,
    told,
)

_NONE = "-"
_HALVES = ("to tell", "to fit")
_SHOULDER = {"shoulder_1.2": 0.036, "shoulder_0.85": 0.036}  # rad, held out
_SAME_LEG, _LEG = 1.15, "go2_leg"
_OF_THE_LOG = ("command_delay", "encoder_offset", "encoder_gain", SIGN_FLIP)


def rows(outcomes: Sequence[PlantedOutcome]) -> list[Row]:
    """The table of some outcomes; what there is none of is left out."""
    known = own_names(outcomes)
    asked = [one for one in outcomes if one.half and one.outcome.verdict != "impossible"]
    table = [Row(what="plants that show", result=f"{len(told(outcomes))} of {len(asked)}")]
    for half in _HALVES:
        some = told(outcomes, half)
        right = [one for one in some if first_in_set(one)]
        stated = [good for one in some for good in sure(one, known.get(one.log, ()))]
        table += [
            _rate(f"first name right or in its set, {half}", answers(some, first_in_set), "90 %"),
            _rate(
                f"the same, ordinary names aside, {half}",
                answers(some, rare_first),
                "",
            ),
            _rate(
                f"the same, names aside that it is given with nothing planted, {half}",
                [first_beside(one, known.get(one.log, ())) for one in some],
                "",
            ),
            _rate(f"its place, {half}", [place_right(one.outcome) for one in some], "90 %"),
            _rate(
                f"its size within 2 standard errors, {half}", answers(right, sizes_right), "90 %"
            ),
            _rate(f"right of the names given with {CONFIDENT} or more, {half}", stated, "90 %"),
            _rate(
                f"right first names given with {SURE_ENOUGH} or more, {half}",
                [one.outcome.named[0].confidence >= SURE_ENOUGH for one in right],
                "50 %",
            ),
        ]
    gains = of_gains(outcomes)
    table += [
        _rate("servo gains: position_gain first", answers(gains, gain_first), "90 %"),
        _rate("servo gains: mass or geometry first", answers(gains, geometry_first), "never"),
    ]
    table += [_shoulder(one) for one in outcomes if one.kind in _SHOULDER]
    table += _leg(outcomes)
    failed = [one for one in outcomes if one.outcome.verdict == "failed"]
    table.append(Row(what="cases that raised an error", result=str(len(failed)), required="0"))
    seconds = [one.outcome.seconds for one in outcomes if one.outcome.seconds]
    if seconds:
        took = f"{np.median(seconds):.0f} s, {max(seconds):.0f} s"
        table.append(Row(what="seconds a diagnosis, median and largest", result=took))
    return [row for row in table if row.result != _NONE]


def line(one: PlantedOutcome) -> str:
    """One line for people about a case."""
    outcome = one.outcome
    if outcome.verdict in ("impossible", "silent"):
        return f"{one.case}: {outcome.verdict}"
    hidden = "; ".join(of.text for of in outcome.hidden) or "nothing"
    named = "; ".join(
        f"{of.effect}{''.join(f' or {other}' for other in of.doubt)} "
        f"[{of.confidence:.2f}] at {', '.join(of.places) or 'all'}"
        f"{''.join(f' {v.name} {v.value:.3g}±{v.std or 0:.2g} ({v.true:.3g})' for v in of.values)}"
        for of in outcome.named
    )
    mark = "" if not one.half else "right" if first_in_set(one) else "WRONG"
    best = one.best.get("position", 0.0)
    return (
        f"{one.case} {outcome.seconds:5.0f} s  {mark:5} planted {hidden}: {outcome.verdict}, named "
        f"{named or 'nothing'}; gap {best:.3g} to {outcome.before:.3g}, after {outcome.after:.3g}"
        f"{f'; {outcome.error}' if outcome.error else ''}"
    )


def _shoulder(one: PlantedOutcome) -> Row:
    """The double pendulum's shoulder with another motor."""
    outcome, most = one.outcome, _SHOULDER[one.kind]
    first = outcome.named[0] if outcome.named else None
    where = f"{first.effect} at {', '.join(first.places)}" if first else "nothing"
    return Row(
        what=f"double_pendulum: {one.kind}",
        result=f"{where} first, {outcome.before:.4f} to {outcome.after:.4f} rad",
        required=f"torque_constant at shoulder, <= {most:g} rad",
    )


def _leg(outcomes: Sequence[PlantedOutcome]) -> list[Row]:
    """Whether the leg ends up as well from any model; its log is the same for all of these."""
    after = [
        one.outcome.after
        for one in outcomes
        if one.log == _LEG
        and one.outcome.after
        and (one.kind == AS_GIVEN or (one.half and one.outcome.hidden))
        and not any(hidden.effect in _OF_THE_LOG for hidden in one.outcome.hidden)
    ]
    if len(after) < 2:
        return []
    low, high = min(after), max(after)
    return [
        Row(
            what=f"{_LEG}: largest gap over smallest from {len(after)} models of one log",
            result=f"{high / low:.2f} ({1000 * low:.2f} to {1000 * high:.2f} mrad)",
            required=f"<= {_SAME_LEG}",
        )
    ]


def _rate(what: str, given: Sequence[bool], required: str) -> Row:
    if not given:
        return Row(what=what, result=_NONE, required=required)
    return Row(
        what=what,
        result=f"{share(given):.0%} ({sum(given)} of {len(given)})",
        required=required,
    )
