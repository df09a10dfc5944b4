"""From the search to the diagnosis: gaps, estimates, verdict, notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import cut
from walkerkit.gap.report.diagnosis import (
    Considered,
    Diagnosis,
    Estimate,
    Gap,
    GapSize,
    NamedEffect,
    NextExperiment,
    Trace,
    Verdict,
)
from walkerkit.gap.report.locate import locate
from walkerkit.gap.report.notes import notes
from walkerkit.gap.report.planner import next_experiment
from walkerkit.gap.search.fit import INSENSITIVE, Fit, covariance
from walkerkit.gap.search.naming import Round
from walkerkit.gap.search.problem import Half, Problem, channel_noise
from walkerkit.gap.search.structure import Term
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_AT_FLOOR = 1.5  # a gap within this factor of noise and numerical error together is none
_QUARTER = 4  # of the timestep, at which the numerical floor is taken
_AT_BOUND = 1e-6  # of the width between the bounds
_MOST_RIVALS = 4
_LONGEST_TRACE = 20000  # samples


@dataclass(frozen=True, kw_only=True)
class Result:
    """A diagnosis together with what it is about.

    Attributes:
        diagnosis: what was found.
        robots: the mended robots, one per experiment.
        problem: the comparison it was found with.
        fit: the named effects with their values.
        next_targets: the targets of the next experiment, where there is one.
    """

    diagnosis: Diagnosis
    robots: tuple[Robot, ...]
    problem: Problem
    fit: Fit
    next_targets: Recording | None

    def __str__(self) -> str:
        from walkerkit.gap.report.console import as_text

        return as_text(self.diagnosis)

    def save(self, folder: str | Path) -> Path:
        """Writes diagnosis.json, report.html, the mended models and actuators.json.

        Args:
            folder: made if it is missing; files of the same names are replaced.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be written.
        """
        from walkerkit.gap.report.output import save

        return save(self, Path(folder))


@dataclass(frozen=True, kw_only=True)
class _Replayed:
    """All replays of one half under one set of robots, with the predictions."""

    replays: tuple[Replay, ...]
    predicted: tuple[FloatArray, ...]

    def residuals(self) -> list[FloatArray]:
        """Predicted minus measured of every replay, (rows, n_channels)."""
        return [p - r.measured for p, r in zip(self.predicted, self.replays, strict=True)]

    def rms(self, channels: Sequence[Channel]) -> float:
        """Root mean square over all samples of some channels."""
        squares, count = 0.0, 0
        for replay, residual in zip(self.replays, self.residuals(), strict=True):
            for c, channel in enumerate(replay.channels):
                if channel in channels:
                    known = ~np.isnan(replay.measured[:, c])
                    squares += float(np.square(residual[known, c]).sum())
                    count += int(known.sum())
        return float(np.sqrt(squares / count)) if count else 0.0


def summarise(
    problem: Problem,
    rounds: Sequence[Round],
    mended: Sequence[Robot],
    *,
    seconds: float,
    searched: bool = True,
) -> Result:
    """Puts a finished search into words and numbers.

    Args:
        problem: what was explained.
        rounds: the search.
        mended: the robots with everything that was named.
        seconds: wall time so far.
        searched: whether effects were looked for.

    Returns:
        The result.
    """
    final = rounds[-1].fit
    before = {half: _replay(problem, half, problem.robots) for half in ("fit", "held")}
    after = {half: _replay(problem, half, mended) for half in ("fit", "held")}
    gap = _gap(problem, before["held"], after["held"])
    effects = _effects(problem, rounds, after["held"])
    verdict = _verdict(gap, bool(effects))
    both = [before[half] for half in ("fit", "held")]
    left = [after[half] for half in ("fit", "held")]
    everything = [r for half in (problem.fit, problem.held) for g in half.recordings for r in g]
    following = _next_experiment(problem, rounds)
    diagnosis = Diagnosis(
        verdict=verdict,
        gap=gap,
        locations=_locate(problem, both),
        remaining=_locate(problem, left) if verdict != "no_gap" else (),
        effects=effects,
        considered=tuple(
            Considered(
                round=number,
                effect=candidate.term.effect.name,
                improvement=float(1 - np.exp(-candidate.gain)),
                verdict="indistinguishable"
                if candidate.close
                else "named"
                if one.named is not None and candidate.term.effect is one.named.effect
                else "lost",
            )
            for number, one in enumerate(rounds, start=1)
            for candidate in one.candidates
        ),
        next_experiment=following[0] if following else None,
        recordings=tuple(dict.fromkeys(recording.whole.name for recording in everything)),
        notes=notes(problem, gap, effects, verdict, searched=searched),
        traces=_traces(problem, before, after),
        seconds=seconds,
        searched=searched,
    )
    return Result(
        diagnosis=diagnosis,
        robots=tuple(replace(robot, hold=problem.hold) for robot in mended),
        problem=problem,
        fit=final,
        next_targets=following[1] if following else None,
    )


def _replay(problem: Problem, half_name: str, robots: Sequence[Robot]) -> _Replayed:
    """Replays a half on robots as they are, numerical error and all."""
    half: Half = getattr(problem, half_name)
    coarse = iter(half.objective.replays)
    replays = []
    for robot, recordings in zip(robots, half.recordings, strict=True):
        if not recordings:
            continue
        template = next(coarse)
        replays.append(
            template
            if robot is template.robot
            else Replay(
                robot,
                cut(recordings, problem.window),
                template.channels,
                hold=problem.hold,
                n_threads=template.n_threads,
            )
        )
    return _Replayed(
        replays=tuple(replays),
        predicted=tuple(replay.predict(Trials(replay.robot, 1))[0] for replay in replays),
    )


def _gap(problem: Problem, before: _Replayed, after: _Replayed) -> Gap:
    channels = before.replays[0].channels
    everything = [r for half in (problem.fit, problem.held) for g in half.recordings for r in g]
    floor = {c: channel_noise(everything, c).std for c in channels}

    def size(chosen: Sequence[Channel]) -> GapSize:
        return GapSize(
            unit=_unit(problem, chosen),
            before=before.rms(chosen),
            after=after.rms(chosen),
            noise_floor=float(np.sqrt(np.mean([floor[c] ** 2 for c in chosen]))),
        )

    positions = [c for c in channels if c.signal == "position"]
    signals = dict.fromkeys(c.signal for c in channels)
    return Gap(
        position=size(positions),
        horizon=problem.window,
        numerical_floor=_numerical_floor(problem, after),
        held_out=True,
        joints={c.joint: size([c]) for c in positions},
        signals={name: size([c for c in channels if c.signal == name]) for name in signals},
    )


def _numerical_floor(problem: Problem, after: _Replayed) -> float:
    """Root-mean-square change of the held-out positions at a quarter of the timestep."""
    finer = []
    for replay in after.replays:
        fine = Replay(
            replay.robot.refined(_QUARTER),
            replay.segments,
            replay.channels,
            hold=problem.hold,
            n_threads=problem.n_threads,
        )
        finer.append(fine.predict(Trials(fine.robot, 1))[0])
    squares, count = 0.0, 0
    for replay, coarse, fine in zip(after.replays, after.predicted, finer, strict=True):
        columns = [c for c, channel in enumerate(replay.channels) if channel.signal == "position"]
        known = np.isfinite(replay.measured[:, columns])
        change = np.where(known, fine[:, columns] - coarse[:, columns], 0.0)
        squares += float(np.square(change).sum())
        count += int(known.sum())
    return float(np.sqrt(squares / count))


def _unit(problem: Problem, channels: Sequence[Channel]) -> str:
    slides = {problem.robots[0].joints[c.joint].slide for c in channels}
    hinge, slide = {
        "position": ("rad", "m"),
        "velocity": ("rad/s", "m/s"),
        "effort": ("N·m", "N"),
    }[channels[0].signal]
    return " and ".join(slide if is_slide else hinge for is_slide in sorted(slides))


def _verdict(gap: Gap, named: bool) -> Verdict:
    floor = np.hypot(gap.position.noise_floor, gap.numerical_floor)
    if named:
        return "explained" if gap.position.after <= _AT_FLOOR * floor else "partly_explained"
    return "no_gap" if gap.position.before <= _AT_FLOOR * floor else "unexplained"


def _effects(
    problem: Problem, rounds: Sequence[Round], after: _Replayed
) -> tuple[NamedEffect, ...]:
    """The terms of the final structure, with the round that named each."""
    final = rounds[-1].fit
    if not final.structure.terms:
        return ()
    variance, sensitivity = covariance(problem.fit.objective, final)
    named = {one.named.effect.name: one for one in rounds if one.named is not None}
    found = []
    for count, term in enumerate(final.structure.terms, start=1):
        one = named[term.effect.name]
        last = count == len(final.structure.terms)
        found.append(
            NamedEffect(
                effect=term.effect.name,
                joints=() if term.effect.kind == "body" else _shown_joints(term),
                bodies=term.sites if term.effect.kind == "body" else (),
                confidence=one.confidence,
                parameters=_estimates(final, term, variance, sensitivity),
                gap_after=after.rms(
                    [c for c in after.replays[0].channels if c.signal == "position"]
                )
                if last
                else _gap_with(problem, one.fit),
                indistinguishable_from=tuple(
                    rival.structure.terms[-1].effect.name for rival in _rivals(one, final)
                ),
            )
        )
    return tuple(found)


def _shown_joints(term: Term) -> tuple[str, ...]:
    return (EVERYWHERE,) if term.shared else term.sites


def _gap_with(problem: Problem, fit: Fit) -> float:
    """Held-out position gap of a fit, numerical error and all."""
    squares, count = 0.0, 0
    for replay in problem.held.objective.replays:
        predicted = replay.predict(fit.structure.trials(replay.robot, fit.values[None]))[0]
        columns = [c for c, channel in enumerate(replay.channels) if channel.signal == "position"]
        error = (predicted - replay.measured)[:, columns]
        squares += float(np.nansum(np.square(error)))
        count += int(np.isfinite(replay.measured[:, columns]).sum())
    return float(np.sqrt(squares / count))


def _estimates(
    fit: Fit, term: Term, variance: FloatArray, sensitivity: FloatArray
) -> tuple[Estimate, ...]:
    lower, upper = fit.structure.bounds
    found = []
    for i in fit.structure.columns(term):
        slot = fit.structure.slots[i]
        margin = _AT_BOUND * (upper[i] - lower[i])
        at_bound = bool(min(fit.values[i] - lower[i], upper[i] - fit.values[i]) <= margin)
        known = sensitivity[i] > INSENSITIVE and not at_bound
        found.append(
            Estimate(
                name=slot.parameter.name,
                place=slot.place,
                value=float(fit.values[i]),
                std=float(np.sqrt(variance[i, i])) if known else None,
                unit=slot.parameter.unit,
                at_bound=at_bound,
            )
        )
    return tuple(found)


def _locate(problem: Problem, halves: Sequence[_Replayed]) -> tuple:  # type: ignore[type-arg]
    replays = [replay for half in halves for replay in half.replays]
    residuals = [residual for half in halves for residual in half.residuals()]
    return locate(replays, residuals, problem.joints)


def _rivals(one: Round, final: Fit) -> list[Fit]:
    """Fits that explained as well as the one that a round named, and were not named after it."""
    present = {term.effect.name for term in final.structure.terms}
    return [
        candidate.fit
        for candidate in one.candidates
        if candidate.close and candidate.term.effect.name not in present
    ]


def _next_experiment(
    problem: Problem, rounds: Sequence[Round]
) -> tuple[NextExperiment, Recording] | None:
    """For the first effect that has rivals, what would part them."""
    final = rounds[-1].fit
    kept = {term.effect.name for term in final.structure.terms}
    for one in rounds:
        rivals = _rivals(one, final)
        if one.named is not None and one.named.effect.name in kept and rivals:
            return next_experiment(problem, [one.fit, *rivals[:_MOST_RIVALS]])
    return None


def _traces(
    problem: Problem, before: dict[str, _Replayed], after: dict[str, _Replayed]
) -> tuple[Trace, ...]:
    """Every measured channel of every recording, held-out recordings first."""
    found = []
    for half in ("held", "fit"):
        pairs = zip(
            before[half].replays,
            before[half].predicted,
            after[half].predicted,
            strict=True,
        )
        for replay, old, new in pairs:
            segments = replay.segments
            names = dict.fromkeys(segment.recording.name for segment in segments)
            owner = np.array([segment.recording.name for segment in segments])
            for name in names:
                rows = np.flatnonzero(owner[replay.segment_of_row] == name)
                rows = rows[:: max(1, len(rows) // _LONGEST_TRACE)]
                start = np.array([segment.start for segment in segments])
                time = replay.time_of_row[rows] + start[replay.segment_of_row[rows]]
                for c, channel in enumerate(replay.channels):
                    if np.isnan(replay.measured[rows, c]).all():
                        continue
                    found.append(
                        Trace(
                            recording=name,
                            joint=channel.joint,
                            signal=channel.signal,
                            unit=_unit(problem, [channel]),
                            held_out=half == "held",
                            time=time,
                            measured=replay.measured[rows, c],
                            before=old[rows, c],
                            after=new[rows, c],
                        )
                    )
    return tuple(found)
