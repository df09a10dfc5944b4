"""The workflow: from recordings to named effects, added to the model.

    from walkerkit import gap

    d = gap.diagnose("leg.xml", ["a.csv", "b.csv", "c.csv"])
    print(d)
    d.save("out")           # diagnosis.json, report.html, model.xml, actuators.json

Each step can be used alone: `load_experiments`, `load_robot`, `split`, `build`, `locate`,
`name_effects`, `mend`.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.blas import on_one_thread
from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.effects.effect import add_users_effect, identity, users_effects
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.experiments.experiment import Experiment, load_experiments
from walkerkit.gap.experiments.split import Recordings, is_in_time, split, split_in_time
from walkerkit.gap.recordings import base_state
from walkerkit.gap.recordings.checks import (
    check_recordings,
    check_seconds,
    check_window,
    lopsided,
    shortest_window,
    source,
    without_echoes,
    without_placeholders,
)
from walkerkit.gap.recordings.given import OneOrMore
from walkerkit.gap.recordings.imu import has_imu
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.tidy import tidied
from walkerkit.gap.report.claim import claimed, run_key
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.first_answer import FILE as FIRST
from walkerkit.gap.report.first_answer import FirstAnswer, first_answer
from walkerkit.gap.report.hints import with_hints
from walkerkit.gap.report.notes import warning_notes
from walkerkit.gap.report.output import DIAGNOSES, main_files
from walkerkit.gap.report.result import Result, summarise
from walkerkit.gap.search.beliefs import NOTHING, Beliefs
from walkerkit.gap.search.buildable import buildable
from walkerkit.gap.search.effort import Effort, Level, Progress, counted
from walkerkit.gap.search.holds import name_with_best_hold
from walkerkit.gap.search.naming import Explanation, name_effects
from walkerkit.gap.search.problem import Problem, build, forgets
from walkerkit.gap.search.starting_states import ALIKE
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.base_estimate import with_known_base
from walkerkit.gap.simulation.commands import Hold, by_effort_alone, driven_by_effort
from walkerkit.gap.simulation.floating import suited
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.phases import phases_of
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import with_sidecar
from walkerkit.gap.simulation.size import check_size
from walkerkit.gap.simulation.untaken import check_memory
from walkerkit.gap.units import (
    with_checked_angles,
    with_checked_extent,
    with_checked_velocities,
)
from walkerkit.gap.wiring import rewired_experiments
from walkerkit.walkers.batch import counted_warnings, without_warnings

FloatArray = NDArray[np.float64]

WINDOW = 0.5  # s
OneOrMoreEffects = str | Effect | type[Effect] | Sequence[str | Effect | type[Effect]]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What the workflow works on, before any hypothesis.

    Attributes:
        robots: one per experiment.
        fitted, held_out: recordings per experiment.
        experiments: models and recordings as they were given.
        beliefs: what the user knows or doubts.
        window: seconds after which replays restart, or None for whole rollouts.
        walks: feet lift off and touch down.
        n_threads: threads of the simulation, 0 for all cores.
    """

    robots: tuple[Robot, ...]
    fitted: Recordings
    held_out: Recordings
    window: float | None
    walks: bool
    n_threads: int
    experiments: tuple[Experiment, ...]
    beliefs: Beliefs = NOTHING

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """All recordings, those that are fitted first."""
        return tuple(r for group in (*self.fitted, *self.held_out) for r in group)

    @property
    def may_split_in_time(self) -> bool:
        """Whether the recordings were split by us, and not in time already."""
        return not self.declared and not is_in_time(self.fitted, self.held_out)

    @property
    def declared(self) -> bool:
        """Whether the user said what is held out."""
        return any(experiment.held_out for experiment in self.experiments)

    def split_in_time(self) -> Setup:
        """The same with blocks of time held out instead of whole recordings."""
        restarts = self.window is not None
        fitted, held_out = split_in_time(self.experiments, restarts=restarts)
        return replace(self, fitted=fitted, held_out=held_out)

    def problem(self, hold: Hold) -> Problem:
        """The comparison under one reading of the targets between their samples."""
        problem = build(
            self.robots,
            self.fitted,
            self.held_out,
            window=self.window,
            walks=self.walks,
            hold=hold,
            n_threads=self.n_threads,
        )
        return replace(problem, beliefs=self.beliefs)


@on_one_thread
def diagnose(
    model: str | Path,
    recordings: OneOrMore = (),
    *,
    held_out: OneOrMore = (),
    skip: Sequence[str] = (),
    column_map: str | Path | None = None,
    window: float | None = None,
    effects: OneOrMoreEffects | None = None,
    known: str | Sequence[str] = (),
    doubt: str | Sequence[str] = (),
    effort: Level | Effort = "normal",
    n_threads: int = 0,
    allow_code: bool = False,
    allow_outside: bool = False,
    progress: Progress | None = None,
    first: Callable[[FirstAnswer], None] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    kind: str = DIAGNOSES,
) -> Result:
    """Finds where simulation and recordings disagree, names why, and mends the model.

    Args:
        model: MJCF file, `package.module:callable`, or a manifest `experiments.toml`.
        recordings: files or recordings of that model, or one; none with a manifest.
        held_out: which of them no fit may see.
        skip: spans of time that are left out, as "walk.csv=8.0:8.6", or "8.0:8.6" of the only one.
        column_map: file of a column map (`walkerkit.gap.ingest`), by which all files are read;
            without one, logs of other formats are read as their names and the model say.
        window: seconds after which replays restart where joints are driven by effort or the
            base floats; by default 0.5, of a robot that walks half as long as its feet stand and
            swing.
        effects: the effects to consider, or one: names, or effects of your own; all by default, to
            which those belong that you have defined.
        known: effects or numbers that are right in the model and are not changed, as "payload",
            or "mass:calf" of one place.
        doubt: effects or numbers of whose size nothing is known; naming them costs nothing.
        effort: how much is tried: "quick", "normal" or "thorough"; an `Effort` can be stopped, and
            what was found until then is the result.
        n_threads: threads of the simulation, and processes of its laws, 0 for all cores. Results
            do not depend on it.
        allow_code: a manifest may name `package.module:callable` as a model.
        allow_outside: a model's meshes and included files may lie outside of its folder.
        progress: called with what is being done and how far it is.
        first: called with the plain fit's held-out gap as soon as that is known.
        out: folder to save the result in, and meanwhile what is finished: the same call after a
            crash goes on from there, to the same result.
        overwrite: whether `out` may replace files of another run.
        kind: of the run; `out` of one demo may be that of the next.

    Returns:
        The diagnosis, with the mended robots.

    Raises:
        InputError: the model or a recording cannot be used, or `out` cannot be written.
    """
    start = time.perf_counter()
    with counted_warnings() as warned, without_warnings():
        setup = prepare(
            load_experiments(
                model,
                recordings,
                held_out=held_out,
                skip=skip,
                column_map=column_map,
                allow_code=allow_code,
                allow_outside=allow_outside,
            ),
            window=window,
            n_threads=n_threads,
            allow_outside=allow_outside,
        )
        chosen = _effects(effects)
        setup = replace(setup, beliefs=Beliefs.of(known, doubt))
        spending = effort if isinstance(effort, Effort) else Effort(effort)

        answers = list[FirstAnswer]()

        def answered(problem: Problem, one: Fit) -> None:
            answer = first_answer(problem, one, time.perf_counter() - start)
            answers.append(answer)
            if out is not None:
                (Path(out) / FIRST).write_text(answer.to_json(), encoding="utf-8")
            if first is not None:
                first(answer)

        def run() -> Result:
            counted()
            result = _search(setup, chosen, progress, spending, answered)
            diagnosis = result.diagnosis
            plain = answers[-1].notes(diagnosis.gap) if answers else ()
            told = (*plain, *diagnosis.notes, *warning_notes(warned))
            seconds = time.perf_counter() - start
            return replace(result, diagnosis=replace(diagnosis, notes=told, seconds=seconds))

        if out is None:
            return run()
        key = _key(setup, chosen, spending.level, kind)
        files = main_files(setup.robots)
        with claimed(Path(out), key, files, overwrite=overwrite, kind=kind) as save:
            result = run()
            (Path(out) / FIRST).unlink(missing_ok=True)
            save(result)
        return result


def _key(setup: Setup, chosen: Sequence[Effect], level: Level, kind: str) -> str:
    """A digest of what the result of a diagnosis depends on."""
    return run_key(
        setup.robots,
        (*setup.fitted, *setup.held_out),
        (
            *(kind, setup.window, setup.may_split_in_time),
            [identity(effect) for effect in chosen],
            *([repr(setup.beliefs)] if setup.beliefs else []),
            level,
        ),
    )


def _search(
    setup: Setup,
    chosen: Sequence[Effect],
    progress: Progress | None,
    effort: Effort,
    first: Callable[[Problem, Fit], None] | None,
) -> Result:
    """Names effects, mends the robots and puts it all into words."""
    problem, explanation, left_out = _named(setup, chosen, progress, effort, first)
    final = explanation.fit
    problem = problem.as_told(final)
    mended = tuple(
        mend(final.structure.trials(robot, final.values[None])) for robot in problem.robots
    )
    if progress:
        progress("writing up", 0.0)
    only = None if len(chosen) == len(CATALOGUE) else tuple(effect.name for effect in chosen)
    result = summarise(problem, explanation, mended, seconds=0.0, only=only)
    held_out_alone = not explanation.searched and result.verdict == "unexplained"
    if held_out_alone and chosen and result.gap.held_out and setup.may_split_in_time:
        again = _search(setup.split_in_time(), chosen, progress, effort, first)
        names = ", ".join(result.diagnosis.held_out)
        moved = (
            f"{names} alone shows a gap, and was to be held out. So that it can be fitted, blocks "
            "of time of all recordings are held out instead."
        )
        notes = (moved, *again.diagnosis.notes)
        return replace(again, diagnosis=replace(again.diagnosis, notes=notes))
    notes = (*left_out, *_untried(explanation, effort), *result.diagnosis.notes)
    return with_hints(replace(result, diagnosis=replace(result.diagnosis, notes=notes)))


def _untried(explanation: Explanation, effort: Effort) -> Iterator[str]:
    """That a search ended before it was done."""
    if explanation.untried:
        why = "You stopped the search" if effort.stopped else f"The effort was {effort.level}"
        yield (
            f"{why}, so that it did not try: {'; '.join(explanation.untried)}. What is named may "
            "stand for something else; --effort thorough tries all."
        )


@on_one_thread
def compare(
    model: str | Path,
    recordings: OneOrMore = (),
    *,
    held_out: OneOrMore = (),
    skip: Sequence[str] = (),
    column_map: str | Path | None = None,
    window: float | None = None,
    n_threads: int = 0,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> Diagnosis:
    """Measures the gap and says where it is, without naming anything.

    Args:
        model: as for `diagnose`.
        recordings: as for `diagnose`.
        held_out: as for `diagnose`.
        skip: as for `diagnose`.
        column_map: as for `diagnose`.
        window: as for `diagnose`.
        n_threads: as for `diagnose`.
        allow_code: as for `diagnose`.
        allow_outside: as for `diagnose`.

    Returns:
        A diagnosis without effects: its gap is the same before and after.

    Raises:
        InputError: the model or a recording cannot be used.
    """
    start = time.perf_counter()
    with counted_warnings() as warned, without_warnings():
        setup = prepare(
            load_experiments(
                model,
                recordings,
                held_out=held_out,
                skip=skip,
                column_map=column_map,
                allow_code=allow_code,
                allow_outside=allow_outside,
            ),
            window=window,
            n_threads=n_threads,
            allow_outside=allow_outside,
        )
        diagnosis = _measured(setup).diagnosis
    notes = (*diagnosis.notes, *warning_notes(warned))
    return replace(diagnosis, notes=notes, seconds=time.perf_counter() - start)


def _measured(setup: Setup) -> Result:
    """The gap and where it is, with nothing named."""
    problem = setup.problem(_known_hold(setup.robots) or "zero_order")
    _check_tells(setup, problem)
    explanation = name_effects(problem, [])
    problem = problem.as_told(explanation.fit)
    return summarise(
        problem,
        explanation,
        problem.robots,
        seconds=0.0,
        searched=False,
        held_out_only=setup.declared,
    )


def prepare(
    experiments: Sequence[Experiment],
    *,
    window: float | None,
    n_threads: int,
    allow_outside: bool = False,
) -> Setup:
    """Loads the robots, splits the recordings and decides how to replay them.

    Args:
        experiments: models and recordings.
        window: seconds after which replays restart where joints are driven by effort or the
            base floats; by default 0.5, of a robot that walks half as long as its feet stand and
            swing.
        n_threads: threads of the simulation, 0 for all cores.
        allow_outside: a model's meshes and included files may lie outside of its folder.

    Raises:
        InputError: a model or recording cannot be used, or they do not fit each other.
    """
    check_seconds(window)
    loaded = [_suiting(experiment, allow_outside=allow_outside) for experiment in experiments]
    robots, suiting = [robot for robot, _ in loaded], [fitting for _, fitting in loaded]
    _check_shared_joints(robots, suiting)
    experiments = without_placeholders(suiting)
    for robot, experiment in zip(robots, experiments, strict=True):
        check_size(robot.model, robot.source, experiment.recordings)
    recordings = [r for experiment in experiments for r in experiment.recordings]
    check_recordings(recordings)
    experiments = tuple(
        replace(experiment, recordings=tuple(_checked(robot, r) for r in experiment.recordings))
        for robot, experiment in zip(robots, experiments, strict=True)
    )
    usual = _usual_window(robots, experiments)
    restarts = _window(robots, experiments, recordings, usual if window is None else window)
    experiments = rewired_experiments(robots, experiments, window=restarts, n_threads=n_threads)
    experiments = tuple(_rewired(robot, e) for robot, e in zip(robots, experiments, strict=True))
    fitted, held_out = split(experiments, restarts=restarts is not None)
    setup = Setup(
        robots=tuple(robots),
        fitted=fitted,
        held_out=held_out,
        window=restarts,
        walks=usual < WINDOW,
        n_threads=n_threads,
        experiments=experiments,
    )
    return _with_whole_halves(setup)


def _suiting(experiment: Experiment, *, allow_outside: bool) -> tuple[Robot, Experiment]:
    """The robot of an experiment, and its recordings as that can use them."""
    floating = any(not base_state.missing(r) or has_imu(r) for r in experiment.recordings)
    robot = load_robot(experiment.model, floating=floating, allow_outside=allow_outside)
    if robot.path is not None:
        robot = with_sidecar(robot, robot.path)
    for recording in experiment.recordings:
        robot.check_joints(recording.joints, source(recording))
    fitting = tuple(
        suited(robot, tidied(with_checked_angles(robot, with_checked_extent(robot, recording))))
        for recording in experiment.recordings
    )
    return robot, replace(experiment, recordings=fitting)


def _usual_window(robots: Sequence[Robot], experiments: Sequence[Experiment]) -> float:
    """The window by default [s]; of a robot that walks half as long as its feet stand and swing.

    With each touch-down what is a little wrong grows, and a step too early or late makes a replay
    jump. But within a moment errors stay alike, and less tells nothing more.
    """
    fitted, _ = split(experiments)
    found = [
        phases_of(robot, recording)
        for robot, mine in zip(robots, fitted, strict=True)
        for recording in mine
    ]
    phases = np.concatenate([*found, np.empty(0)])
    half = 0.5 * float(np.median(phases)) if phases.size else WINDOW
    recordings = [r for experiment in experiments for r in experiment.recordings]
    least = max(ALIKE, *map(shortest_window, recordings))
    return max(least, min(WINDOW, half))


def _window(
    robots: Sequence[Robot],
    experiments: Sequence[Experiment],
    recordings: Sequence[Recording],
    window: float,
) -> float | None:
    """The window where joints are driven by effort or a base floats, or None.

    Raises:
        InputError: it is too short, or a robot remembers more than it would be given.
    """
    windowed = any(
        robot.base is not None or driven_by_effort(robot, recording)
        for robot, experiment in zip(robots, experiments, strict=True)
        for recording in experiment.recordings
    )
    if not windowed:
        return None
    check_window(window, recordings)
    for robot, experiment in zip(robots, experiments, strict=True):
        check_memory(robot, experiment.recordings)
    return window


def _with_whole_halves(setup: Setup) -> Setup:
    """A setup of which both halves have the same columns, split in time where that helps.

    Raises:
        InputError: one half lacks a column, and the user said what is held out.
    """
    column = lopsided([*itertools.chain(*setup.fitted)], [*itertools.chain(*setup.held_out)])
    if column is None:
        return setup
    if not setup.may_split_in_time:
        raise InputError(
            f"column {column!r} is in the recordings that are held out or in those that are "
            "fitted, but not in both. Hold out others, or none, so that each half has it."
        )
    return setup.split_in_time()


def _checked(robot: Robot, recording: Recording) -> Recording:
    """A recording without pauses, with what its signals say of each other."""
    recording = with_checked_velocities(robot, recording)
    if robot.base is not None:
        recording = base_state.with_checked_base(with_known_base(robot, recording))
    return without_echoes(recording, by_effort_alone(robot, recording))


def _rewired(robot: Robot, experiment: Experiment) -> Experiment:
    """An experiment whose bases are estimated anew where joints were wired otherwise."""
    return replace(
        experiment,
        recordings=tuple(
            with_known_base(robot, one, again=bool(one.wiring)) for one in experiment.recordings
        ),
    )


def _check_shared_joints(robots: Sequence[Robot], experiments: Sequence[Experiment]) -> None:
    """Raises InputError where a model lacks a joint that another model's recordings measure."""
    for measured, experiment in zip(robots, experiments, strict=True):
        for joint in dict.fromkeys(j for r in experiment.recordings for j in r.joints):
            for robot in robots:
                if joint not in robot.joints:
                    raise InputError(
                        f"{robot.source}: the model has no joint {joint!r}"
                        f"{closest(joint, robot.joints)}, which the recordings of "
                        f"{measured.source} measure. All models of a manifest share the effects: "
                        "give them joints of the same names, or diagnose them one by one or as a "
                        "fleet (walkerkit diagnose-fleet)."
                    )


def effect_names(effects: OneOrMoreEffects | None) -> tuple[str, ...] | None:
    """Names of effects, a single one as a tuple of one; None stays for all.

    Args:
        effects: names, effects, or their classes; what is of a user's own joins the catalogue.

    Raises:
        InputError: one of them is not in the catalogue, or no effect.
    """
    if effects is None:
        return None
    one = isinstance(effects, str | Effect | type)
    listed = tuple(map(_name_of, (effects,) if one else effects))  # type: ignore[arg-type]
    for name in listed:
        if name not in CATALOGUE:
            raise InputError(
                f"effect {name!r} is not in the catalogue{closest(name, CATALOGUE)}: "
                f"{', '.join(CATALOGUE)}."
            )
    return listed


def effects_to_send(effects: OneOrMoreEffects | None) -> tuple[str | Effect, ...] | None:
    """As `effect_names`, with a user's own as objects, which another process does not know by name.

    None stays where a user has defined none.
    """
    chosen, own = effect_names(effects), users_effects()
    if chosen is None and own:
        chosen = tuple(CATALOGUE)
    return None if chosen is None else tuple(own.get(name, name) for name in chosen)


def _name_of(effect: str | Effect | type[Effect]) -> str:
    if isinstance(effect, str):
        return effect
    if isinstance(effect, type) and issubclass(effect, Effect) and not effect.__abstractmethods__:
        effect = effect()
    if not isinstance(effect, Effect):
        raise InputError(
            f"effects has {effect!r}, which is neither the name of an effect nor an effect. Give "
            "the name, or an object of a subclass of walkerkit.gap.effects.Effect."
        )
    add_users_effect(effect)
    return effect.name


def _effects(effects: OneOrMoreEffects | None) -> list[Effect]:
    chosen = effect_names(effects)
    return [effect for name, effect in CATALOGUE.items() if chosen is None or name in chosen]


def _check_tells(setup: Setup, problem: Problem) -> None:
    """Refuses recordings of which no replay can tell anything: it forgets where it started.

    Raises:
        InputError: the errors of the states that replays restart from move the joints further than
            these moved.
    """
    joint, shorter = forgets(problem), problem.window
    if joint is None or shorter is None:
        return
    remedy = (
        "No shorter window helps: log velocities with less noise and at a higher rate, or have the "
        "joints follow position targets."
    )
    with contextlib.suppress(InputError):  # of a window that is too short
        while True:
            shorter /= 2
            check_window(shorter, problem.recordings)
            if forgets(replace(setup, window=shorter).problem(problem.hold)) is None:
                remedy = f"Give a window of {shorter:.2g} s (--window {shorter:.2g})."
                break
    raise InputError(
        f"replays that restart every {setup.window:g} s tell nothing of this robot: the errors of "
        "the states that they start from move its joints further than these moved meanwhile, "
        f"{joint!r} most of all. {remedy}"
    )


def _known_hold(robots: Sequence[Robot]) -> Hold | None:
    return next((robot.hold for robot in robots if robot.hold is not None), None)


def _named(
    setup: Setup,
    effects: Sequence[Effect],
    progress: Progress | None,
    effort: Effort,
    first: Callable[[Problem, Fit], None] | None,
) -> tuple[Problem, Explanation, tuple[str, ...]]:
    """Names the effects that the robots can have; with a note of each that they cannot."""
    known = _known_hold(setup.robots)
    read = setup.problem(known or "zero_order")
    _check_tells(setup, read)
    possible, left_out = buildable(effects, read.robots, read.joints)
    setup.beliefs.check(possible, read.robots, read.joints)

    def problem(hold: Hold) -> Problem:
        return read if hold == read.hold else setup.problem(hold)

    found = name_with_best_hold(problem, known, possible, progress, effort=effort, first=first)
    return *found, left_out
