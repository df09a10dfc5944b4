"""What a reader should know before trusting the numbers of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import mujoco
import numpy as np

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.effects.equivalences import spelled_out
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.wiring_errors import named_errors
from walkerkit.gap.report.diagnosis import NamedEffect, Verdict
from walkerkit.gap.report.folded import folded
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.quantity import percent, quantity
from walkerkit.gap.report.wording import listed
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.commands import Route, by_effort_alone, routes
from walkerkit.gap.simulation.programs import rest_controls
from walkerkit.gap.simulation.robot import Joint, Robot

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_UNSURE = 0.9
_SOME = 3  # of several, that are listed
_HARDLY = 1e-3  # of a ctrlrange, that a target may be beyond it
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
    verdict: Verdict,
    *,
    scales: Mapping[str, float],
    offsets: Mapping[str, float],
    searched: bool,
    only: Sequence[str] | None,
) -> Iterator[str]:
    """The notes of a diagnosis, most important first.

    Args:
        problem: what was explained.
        gap: its gap.
        effects: what was named.
        verdict: the verdict.
        scales: joint to logged over simulated effort, where that is all that is wrong with it.
        offsets: joint to logged less simulated position, where that is all that is wrong with it.
        searched: whether effects were looked for.
        only: their names, where it was not the whole catalogue.
    """
    seen = {recording.name: recording for recording in problem.recordings}
    wholes = {recording.whole.name: recording.whole for recording in seen.values()}
    for error in named_errors([*seen.values()]):
        yield error.sentence(wholes.keys() <= {*error.recordings})
    yield from _diverging(problem, gap)
    halves = problem.fit.recordings, problem.held.recordings
    logged = [
        (robot, (*fit, *held)) for robot, fit, held in zip(problem.robots, *halves, strict=True)
    ]
    for told in (_clipped, _lacking):
        yield from dict.fromkeys(note for pair in logged for note in told(*pair))
    every = {named.effect for named in effects}
    for named in effects:
        yield from _of_effect(named)
        for pair, reason in spelled_out(named.effect, beside=every).items():
            yield (
                f"{named.effect} is the shorter name for {' and '.join(pair)} together, which "
                f"leave the same log. {reason}"
            )
    yield from _constant_errors(gap, scales, offsets)
    yield from _of_verdict(verdict, gap, bool(effects), searched, only)
    yield from _numerical_error(problem, gap, effects, searched=searched)
    yield from _brief(wholes.values())
    yield from _how_replayed(problem)
    if gap.horizon is not None:
        yield (
            f"{_why_restarted(logged)}, so replays restart from the measured state every "
            f"{gap.horizon:g} s; what the noise of that state makes of them is part of the noise "
            "floor."
        )
    yield from dict.fromkeys(note for robot in problem.robots for note in robot.notes)
    yield from folded(seen.values())
    for told in (_passive, _in_volts, _unsent):
        yield from dict.fromkeys(note for pair in logged for note in told(*pair))
    unused = sorted({column for recording in seen.values() for column in recording.unused})
    if unused:
        yield f"Columns that nothing uses: {', '.join(unused)}."


def _diverging(problem: Problem, gap: Gap) -> Iterator[str]:
    """That the models as they were given cannot be simulated."""
    if math.isnan(gap.position.before):
        steps = " and ".join(
            f"{robot.source} at its timestep of {robot.model.opt.timestep:g} s"
            for robot in problem.robots
        )
        yield (
            f"The simulation diverges with the model as it was given: {steps}. Give it a shorter "
            'timestep or integrator="implicitfast": no effect can be seen before.'
        )


def _constant_errors(
    gap: Gap, scales: Mapping[str, float], offsets: Mapping[str, float]
) -> Iterator[str]:
    """What is wrong with a column in every motion alike."""
    if scales:
        listed = ", ".join(f"{scale:.4g} times at {joint}" for joint, scale in scales.items())
        yield (
            f"The logged effort is what the simulation makes of the same motion, {listed}: its "
            "unit or its torque constant may be another's. Divide the columns, and diagnose again."
        )
    for joint, offset in offsets.items():
        yield (
            f"{joint}/position is {quantity(abs(offset), gap.joints[joint].unit)} "
            f"{'more' if offset > 0 else 'less'} than the simulation's in every motion, and hardly "
            "anything else is wrong with it: see whether the log and the drive have the same zero."
        )


def _of_verdict(
    verdict: Verdict, gap: Gap, named: bool, searched: bool, only: Sequence[str] | None
) -> Iterator[str]:
    """What the verdict leaves to be done."""
    if verdict == "unexplained" and named:
        yield (
            "What is named makes the gap of the fitted recordings smaller, and that of the "
            "held-out ones larger: it stands for something that only the fitted ones have, or "
            "that the catalogue lacks. Do not use the mended model; fit recordings that move as "
            "the held-out ones do, and diagnose again."
        )
    elif verdict == "unexplained":
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


def _numerical_error(
    problem: Problem, gap: Gap, effects: Sequence[NamedEffect], *, searched: bool
) -> Iterator[str]:
    """How far the timestep moves the positions, where that is more than the noise."""
    if gap.finer_position is None:
        return
    chosen = _chosen_timestep(effects)
    step, unit = chosen or problem.robots[0].model.opt.timestep, gap.position.unit
    finer = gap.finer_position
    moved, before, after = (
        quantity(size, unit) for size in (gap.position.numerical_floor, finer.before, finer.after)
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


def _brief(wholes: Collection[Recording]) -> Iterator[str]:
    """That the recordings are too short."""
    seconds = sum(whole.duration for whole in wholes)
    if seconds < _BRIEF:
        yield (
            f"All recordings together last {seconds:.2g} s, in which few effects show: neither a "
            "name nor that nothing is missing holds beyond them. Record some ten seconds of each "
            "kind of motion."
        )


def _how_replayed(problem: Problem) -> Iterator[str]:
    """What the recordings themselves said of how to replay them."""
    if any(robot.reads_effort_first for robot in problem.robots):
        yield (
            "Efforts were taken to be read before the targets beside them act, or in the cycle "
            "before, as by a loop that reads, computes and sends; the recordings agree with that."
        )
    if any(robot.starts_as_stepped for robot in problem.robots):
        yield (
            "Replays restart with the velocities that steps of the model's own length have, half a "
            "step before their positions, which leaves less than half as much: the recordings seem "
            "to come from a simulation in such steps."
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
            "Targets were interpolated between their samples, but for steps, which explains the "
            "recordings better than holding them: the log seems to be no faster than the control "
            "loop itself. Where it is slower, log at the rate of the loop."
        )


def _why_restarted(logged: Sequence[tuple[Robot, Sequence[Recording]]]) -> str:
    """Why replays restart from the measured state."""
    if any(robot.base is not None for robot, _ in logged):
        return "The base floats"
    loose: dict[str, None] = {}
    pushed = False
    for robot, recordings in logged:
        for recording in recordings:
            loose.update(dict.fromkeys(by_effort_alone(robot, recording)))
            pushed |= any(
                route.joint is not None and route.joint.name in loose
                for route in routes(robot, recording)
            )
    return "Joints are driven by effort" if pushed else f"Nothing holds {', '.join(loose)}"


def _passive(robot: Robot, recordings: Sequence[Recording]) -> Iterator[str]:
    """The measured joints that nothing drives."""
    moved = {name for one in robot.movers for name in one.joints}
    found: dict[str, None] = {}
    for recording in recordings:
        driven = {r.joint.name for r in routes(robot, recording) if r.joint is not None}
        loose = by_effort_alone(robot, recording)
        found.update(dict.fromkeys(joint for joint in loose if joint not in driven | moved))
    if found:
        names = ", ".join(map(repr, found))
        yield (
            f"joint {names} has no target and is taken as passive"
            if len(found) == 1
            else f"joints {names} have no target and are taken as passive"
        )


def _in_volts(robot: Robot, recordings: Sequence[Recording]) -> Iterator[str]:
    """The effort targets that were read as voltages."""
    found: dict[str, None] = {}
    for recording in recordings:
        for route in routes(robot, recording):
            volts = route.drive is not None and route.drive.kind == "voltage"
            if volts and route.column.endswith("/effort_target"):
                found[route.column] = None
    for column in found:
        better = column.replace("effort_target", "voltage_target")
        yield (
            f"{column} was read in volts, as the motor of that joint takes them. Call it "
            f"{better}; give the joint a <motor> if it is N·m."
        )


def _unsent(robot: Robot, recordings: Sequence[Recording]) -> Iterator[str]:
    """The actuators of measured joints that no recording has a target of, beside those it has."""
    control = rest_controls(robot)
    sent = {r.drive.ctrl for one in recordings for r in routes(robot, one) if r.drive is not None}
    measured = dict.fromkeys(name for one in recordings for name in one.joints)
    lacking = [
        f"{robot.model.actuator(drive.actuator).name or 'one without a name'} of {name} "
        f"(for {drive.kind}, held at the control {control[drive.ctrl]:.4g})"
        for name in measured
        for drive in robot.joints[name].commanded
        if drive.ctrl not in sent and not drive.in_python
    ]
    if lacking:
        yield (
            f"No recording has a target of some actuators of {robot.source}: {'; '.join(lacking)}. "
            "Log what they were sent as `<actuator>/<kind>_target`, or take them out of the model."
        )


def _clipped(robot: Robot, recordings: Sequence[Recording]) -> Iterator[str]:
    """Targets that the model's own actuators do not take as they are."""
    if robot.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
        return
    reached: dict[str, tuple[Route, list[float]]] = {}
    for recording in recordings:
        for route in routes(robot, recording):
            values = recording.whole.columns[route.column]
            _, ends = reached.setdefault(route.column, (route, []))
            ends += [float(values.min()), float(values.max())]
    clipped = [told for route, ends in reached.values() if (told := _beyond(robot, route, ends))]
    if clipped:
        yield (
            f"{robot.source} clips targets at the ctrlrange of their actuators: "
            f"{'; '.join(clipped)}. Widen the ctrlrange, or leave it out, unless the robot's own "
            "drives clip their targets so."
        )


def _beyond(robot: Robot, route: Route, ends: Sequence[float]) -> str:
    """How far a target goes beyond what its actuator takes; "" where it does not."""
    drive, model = route.drive, robot.model
    if drive is None or drive.in_python or not model.actuator_ctrllimited[drive.ctrl]:
        return ""
    limits = model.actuator_ctrlrange[drive.ctrl]
    low, high = sorted(float((limit - drive.offset) / drive.slope) for limit in limits)
    margin = _HARDLY * (high - low)
    if low - margin <= min(ends) and max(ends) <= high + margin:
        return ""
    unit = ""
    if route.joint is not None:
        unit = f" {Channel(joint='', signal=drive.kind).unit(slide=route.joint.slide)}"
    return (
        f"{route.column} goes from {min(ends):.3g} to {max(ends):.3g}{unit}, and "
        f"{model.actuator(drive.actuator).name or 'its actuator'}, "
        f'ctrlrange="{limits[0]:.4g} {limits[1]:.4g}", takes {low:.4g} to {high:.4g}{unit}'
    )


def _lacking(robot: Robot, recordings: Sequence[Recording]) -> Iterator[str]:
    """The joints of a model that its recordings do not have, and what the simulation does there."""
    logs = {recording.whole.name: recording.whole for recording in recordings}
    # What lies between a motor and its link follows from what the other side shows.
    inner = {joint.play.name for joint in robot.joints.values() if joint.play is not None}
    alike: dict[str, list[str]] = {}
    for name, joint in robot.joints.items():
        without = [log for log, one in logs.items() if name not in one.joints]
        if without and name not in inner and name not in robot.loops.joints:
            which = "" if len(without) == len(logs) else f", in {', '.join(without)}"
            alike.setdefault(f"{_unlogged(robot, joint)}{which}", []).append(name)
    if alike:
        pose = "first keyframe" if robot.model.nkey else "reference pose"
        listed = "; ".join(f"{', '.join(names)} ({how})" for how, names in alike.items())
        yield (
            f"The recordings lack joints that the model has: {listed}. The simulation starts them "
            f"at rest where the model's {pose} has them. Log them, or weld in the model what did "
            "not move."
        )


def _unlogged(robot: Robot, joint: Joint) -> str:
    """What a simulation does with a joint that is not logged."""
    model, control = robot.model, rest_controls(robot)
    drive = joint.drive("position") or joint.drive("velocity")
    if drive is not None:
        at = float((control[drive.ctrl] - drive.offset) / drive.slope) + 0.0  # never -0
        unit = Channel(joint=joint.name, signal=drive.kind).unit(slide=joint.slide)
        return f"held at {at:.4g} {unit} by its actuator"
    own = np.isin(model.actuator_trntype, _ON_JOINT) & (model.actuator_trnid[:, 0] == joint.id)
    own[[one.actuator for one in robot.movers if joint.name in one.joints]] = True
    sent = control[model.actuator_ctrladr[own]]
    if len(sent) == len(joint.drives) and not sent.any():
        return "free"  # there are motors at most
    return f"its actuator gets the control {', '.join(f'{one:.4g}' for one in sent)}"


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


def _of_lookalikes(named: NamedEffect) -> Iterator[str]:
    """Why what is named may be of a kind that is not listed."""
    if not named.lookalikes:
        return
    more = len(named.lookalikes) - _SOME
    others = [*named.lookalikes[:_SOME], *([f"{more} more"] if more > 0 else [])]
    yield (
        f"{named.effect} makes up for {percent(named.share)} of the gap where it acts. If the "
        f"catalogue had no {listed(others, 'or')}, it would make up for as much of that: what is "
        "there may be of a kind that the catalogue does not have."
    )


def _of_effect(named: NamedEffect) -> Iterator[str]:
    if named.indistinguishable_from:
        yield (
            f"{named.effect} cannot be told from {', '.join(named.indistinguishable_from)} with "
            "these recordings and channels; it stands for all of them."
        )
    if named.confidence < _UNSURE:
        yield f"{named.effect} is named with a confidence of only {named.confidence:.2f}."
        yield from _of_lookalikes(named)
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
