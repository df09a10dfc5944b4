"""What a reader should know before trusting the numbers of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.effects.equivalences import spelled_out
from walkerkit.gap.recordings.wiring import named_errors
from walkerkit.gap.report.diagnosis import NamedEffect, Verdict
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.quantity import percent, quantity
from walkerkit.gap.search.problem import Problem

_UNSURE = 0.9
_BRIEF = 2.0  # s


def warning_notes(warned: Mapping[str, int]) -> tuple[str, ...]:
    """How many of a run's simulations MuJoCo warned of, by kind."""
    if not warned:
        return ()
    kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(warned.items()))
    return (
        f"MuJoCo warned of some simulations: {kinds}. Those that diverged were taken for "
        "impossible; the others went on.",
    )


def notes(
    problem: Problem,
    gap: Gap,
    effects: Sequence[NamedEffect],
    stand_ins: Sequence[Sequence[str]],
    verdict: Verdict,
    *,
    scales: Mapping[str, float],
    searched: bool,
    only: Sequence[str] | None,
) -> Iterator[str]:
    """The notes of a diagnosis, most important first.

    Args:
        problem: what was explained.
        gap: its gap.
        effects: what was named.
        stand_ins: names that may together be one.
        verdict: the verdict.
        scales: joint to logged over simulated effort, where that is all that is wrong with it.
        searched: whether effects were looked for.
        only: their names, where it was not the whole catalogue.
    """
    seen = {recording.name: recording for recording in problem.recordings}
    wholes = {recording.whole.name for recording in seen.values()}
    for error in named_errors([*seen.values()]):
        yield error.sentence(wholes <= {*error.recordings})
    if math.isnan(gap.position.before):
        steps = " and ".join(
            f"{robot.source} at its timestep of {robot.model.opt.timestep:g} s"
            for robot in problem.robots
        )
        yield (
            f"The simulation diverges with the model as it was given: {steps}. Give it a shorter "
            'timestep or integrator="implicitfast": no effect can be seen before.'
        )
    every = {named.effect for named in effects}
    for named in effects:
        yield from _of_effect(named)
        for pair, reason in spelled_out(named.effect, beside=every).items():
            yield (
                f"{named.effect} is the shorter name for {' and '.join(pair)} together, which "
                f"leave the same log. {reason}"
            )
    for names in stand_ins:
        yield (
            f"{', '.join(names[:-1])} and {names[-1]} may together stand in for one that the "
            "catalogue lacks: trust the gap that they close more than their names."
        )
    if scales:
        listed = ", ".join(f"{scale:.4g} times at {joint}" for joint, scale in scales.items())
        yield (
            f"The logged effort is what the simulation makes of the same motion, {listed}: its "
            "unit or its torque constant may be another's. Divide the columns, and diagnose again."
        )
    if verdict == "unexplained":
        yield (
            f"Nothing {'in the catalogue' if only is None else 'that was tried'} makes the "
            "held-out gap smaller by more than chance. The locations show the regime that a "
            "missing effect would have to act in."
            if searched and only != ()
            else "`walkerkit diagnose` with the same arguments looks for the missing effect."
        )
    if verdict == "partly_explained":
        yield (
            "A gap remains above the floor that no further effect of the catalogue explains; "
            "mind it before you trust the model beyond these motions."
        )
        for signal, size in gap.besides.items():
            if not size.mostly_closed:
                before, after = (quantity(one, size.unit) for one in (size.before, size.after))
                yield (
                    f"The {signal} error is {before} before and {after} after: what is named "
                    f"explains {percent(size.closed)} of the way to its floor."
                )
    if gap.finer_position is not None:
        chosen = _chosen_timestep(effects)
        step, unit = chosen or problem.robots[0].model.opt.timestep, gap.position.unit
        finer = gap.finer_position
        moved, before, after = (
            quantity(size, unit)
            for size in (gap.position.numerical_floor, finer.before, finer.after)
        )
        move, dry = "moves", ""
        if gap.drier:
            move, dry = "and its soft dry friction move", ", with friction as dry as it goes,"
        yield (
            f"The simulation's own timestep of {step:g} s {move} the positions by "
            f"{moved}, more than the noise"
            f"{'; effects were judged with that error taken out' if searched else ''}. At a "
            f"quarter of the timestep{dry} the position error is "
            # That of the model as given is another timestep's.
            f"{after if chosen else f'{before} before and {after} after' if effects else before}."
        )
    seconds = sum(r.whole.duration for r in {r.whole.name: r for r in seen.values()}.values())
    if seconds < _BRIEF:
        yield (
            f"All recordings together last {seconds:.2g} s, in which few effects show: neither a "
            "name nor that nothing is missing holds beyond them. Record some ten seconds of each "
            "kind of motion."
        )
    if any(robot.reads_effort_first for robot in problem.robots):
        yield (
            "Efforts were taken to be read before the targets beside them act, as by a loop that "
            "reads, computes and sends; the recordings agree with that."
        )
    if problem.hold == "next":
        yield (
            "Targets were taken to act from the row before the one that shows them, which explains "
            "the recordings better: the log seems to be written after the step that a target was "
            "for. Log what is sent in the row of what was measured before it, or move the targets "
            "up by a row."
        )
    if problem.hold == "linear":
        yield (
            "Targets were interpolated between their samples, which explains the recordings "
            "better than holding them; the log seems to be as fast as the control loop itself."
        )
    if gap.horizon is not None:
        floats = any(robot.base is not None for robot in problem.robots)
        why = "The base floats" if floats else "Joints are driven by effort"
        yield (
            f"{why}, so replays restart from the measured state every {gap.horizon:g} s; what the "
            "noise of that state makes of them is part of the noise floor."
        )
    yield from dict.fromkeys(note for robot in problem.robots for note in robot.notes)
    for recording in seen.values():
        yield from (f"{recording.name}: {note}" for note in recording.notes)
    unused = sorted({column for recording in seen.values() for column in recording.unused})
    if unused:
        yield f"Columns that nothing uses: {', '.join(unused)}."


def _chosen_timestep(effects: Sequence[NamedEffect]) -> float | None:
    """The timestep that is named [s]."""
    return next(
        (
            of.value
            for named in effects
            if named.effect == "timestep"
            for of in named.parameters
            if of.name == "timestep"
        ),
        None,
    )


def _of_effect(named: NamedEffect) -> Iterator[str]:
    if named.indistinguishable_from:
        yield (
            f"{named.effect} cannot be told from {', '.join(named.indistinguishable_from)} with "
            "these recordings and channels; it stands for all of them."
        )
    if named.confidence < _UNSURE:
        yield f"{named.effect} is named with a confidence of only {named.confidence:.2f}."
    if not CATALOGUE[named.effect].fitted:
        return
    for estimate in named.parameters:
        place = "" if estimate.place == "*" else f" of {estimate.place}"
        value = f"{estimate.value:.4g} {'' if estimate.unit == '1' else estimate.unit}".rstrip()
        if estimate.at_bound:
            yield (
                f"{named.effect}: {estimate.name}{place} ran into its bound "
                f"{value} and is no estimate."
            )
        elif estimate.std is None:
            yield (
                f"{named.effect}: the recordings say nothing of {estimate.name}{place}; its value "
                f"{value} means nothing."
            )
