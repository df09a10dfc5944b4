"""A policy's gap in sentences, and in the cells of its table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from walkerkit.gap.policy.outcome import Outcome, Part, RivalPart
from walkerkit.gap.policy.statistics import Interval
from walkerkit.gap.report.quantity import number, percent, scale

if TYPE_CHECKING:
    from walkerkit.gap.policy.policy_gap import PolicyGap

COLUMNS = ("robot", "return", "falls", "tracking", "seconds")
_OF = {"return": "the return", "falls": "the episodes, by falls", "tracking": "the tracking error"}


def answer(found: PolicyGap) -> str:
    """Which effect breaks the policy, a sentence or two."""
    of = found.judgement
    if found.blamed:
        parts = {one.effect: one for one in of.parts}
        told = " and ".join(
            f"{name}, whose part is {share(found, parts[name].part)}" for name in found.blamed
        )
        verb = "breaks" if len(found.blamed) == 1 else "break"
        return f"What {verb} this policy is {told}."
    if of.verdict == "harmless":
        return (
            f"No effect breaks this policy: all together cost {share(found, of.loss)}, which is "
            f"less than the {percent(found.share)} that may be lost."
        )
    open_ = [one.effect for one in of.parts if one.verdict == "undecided"]
    if of.verdict == "breaks":
        also = f" {' or '.join(open_)} may, which these episodes cannot tell." if open_ else ""
        return (
            f"All effects together break this policy, at {share(found, of.loss)}, and none of them "
            f"is known to do so by its own part.{also}"
        )
    return (
        f"It cannot be told whether an effect breaks this policy: all together cost "
        f"{share(found, of.loss)}, and {percent(found.share)} may be lost."
    )


def next_step(found: PolicyGap) -> str:
    """What would change the answer, a sentence or two."""
    of = found.judgement
    episodes = len(found.outcomes[0].episodes)
    more = f"More episodes narrow the intervals: {4 * episodes} halve them."
    if of.verdict == "undecided":
        return more
    if of.hangs_on:
        hangs = "; ".join(
            f"with {one.effect} for {one.in_place_of} it {_would(one)}" for one in of.hangs_on
        )
        wanted = found.next_experiment
        if wanted is None:
            return f"The answer hangs on what was not told apart: {hangs}. No experiment is known."
        file = f", {wanted['file']}" if wanted.get("file") else ""
        instruction = f" {wanted['instruction']}" if wanted.get("instruction") else ""
        return (
            f"The answer hangs on what was not told apart: {hangs}. Record the diagnosis' next "
            f"experiment, {wanted['excitation']}{file}, which parts "
            f"{' from '.join(wanted['between'])}.{instruction}"
        )
    if any(one.verdict == "undecided" for one in of.rivals):
        return f"Whether a rival would change the answer cannot be told. {more}"
    if of.rivals:
        return (
            "No experiment would change the answer: the policy fares the same with each member of "
            "the confusion set."
        )
    if any(one.verdict == "undecided" for one in of.parts):
        return more
    return "No experiment would change the answer: nothing was left that could not be told apart."


def share(found: PolicyGap, loss: Interval) -> str:
    """A loss as a share of what the policy may lose it of, with its interval."""
    size = found.judgement.margin / found.share
    return f"{_percent(loss.over(size))} of {_OF[found.measure]}"


def cells(outcome: Outcome, unit: str) -> tuple[str, ...]:
    """A row of the table, as `COLUMNS` has it."""
    episodes = outcome.episodes
    fell = sum(one.fell for one in episodes)
    falls = outcome.falls
    tracking = outcome.tracking
    seconds = sum(one.seconds for one in episodes) / len(episodes)
    return (
        outcome.name,
        interval(outcome.total, 3),
        f"{fell} of {len(episodes)} ({round(100 * falls.low)}–{round(100 * falls.high)} %)",
        "" if tracking is None else _with_unit(tracking, unit),
        number(seconds, 2),
    )


def part_cells(found: PolicyGap, part: Part) -> tuple[str, ...]:
    """An effect's row: its part, what it takes alone, what is regained without it."""
    size = found.judgement.margin / found.share
    three = (part.part, part.alone, part.regained)
    return (part.effect, *(_percent(one.over(size)) for one in three), says(part.verdict))


def rival_cells(found: PolicyGap, rival: RivalPart) -> tuple[str, ...]:
    """A rival's row."""
    loss = rival.loss.over(found.judgement.margin / found.share)
    return (
        f"{rival.effect} for {rival.in_place_of}",
        _percent(loss),
        says(rival.verdict),
    )


def says(verdict: str) -> str:
    """A verdict in words."""
    return {"breaks": "breaks it", "harmless": "harmless", "undecided": "cannot tell"}[verdict]


def interval(of: Interval, digits: int = 2) -> str:
    """A mean and half the width of its interval."""
    return f"{number(of.mean, digits)} ± {number(of.half, 2)}"


def _with_unit(of: Interval, unit: str) -> str:
    chosen = scale(of.mean, unit)
    mean, half = number(of.mean * chosen.factor, 3), number(of.half * chosen.factor, 1)
    return f"{mean} ± {half} {chosen.unit}".rstrip()


def _percent(of: Interval) -> str:
    return f"{percent(of.mean).removesuffix(' %')} ± {percent(of.half)}"


def _would(rival: RivalPart) -> str:
    return "breaks" if rival.verdict == "breaks" else "does not break"
