"""Holds: what a log's targets are between their samples, and the effects named under that.

    problem, explanation = name_with_best_hold(make_problem, None, effects)

A drive holds its last command, but a log at the rate of the control loop itself is better read
between samples than held for a simulation that is faster than the loop. And a log may show at the
end of a period what was commanded in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.search.buildable import buildable
from walkerkit.gap.search.effort import Effort
from walkerkit.gap.search.fit import Progress, evaluate, polished
from walkerkit.gap.search.naming import Explanation, leaves_nothing, name_effects
from walkerkit.gap.search.objective import refine
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, carried
from walkerkit.gap.simulation.commands import Hold

FloatArray = NDArray[np.float64]

_FLEXIBLE_STEPS = 8
_FLEXIBLE = (
    "viscous_friction",
    "coulomb_friction",
    "armature",
    "position_gain",
    "velocity_gain",
    "torque_bias",
)
_OTHERS: tuple[Hold, ...] = ("linear", "next")
_LATE = ("command_delay", "sensor_delay", "loop_delay")
_LONGER = 1.2  # samples in a step, which jitter does not make
_MARGIN = 0.1  # the score by which other targets have to be better than held ones


def name_with_best_hold(
    make_problem: Callable[[Hold], Problem],
    known: Hold | None,
    effects: Sequence[Effect],
    progress: Progress | None = None,
    *,
    effort: Effort | None = None,
    first: Callable[[Problem, Fit], None] | None = None,
) -> tuple[Problem, Explanation]:
    """Names effects with held targets and, where that leaves a gap, with others that suit better.

    Args:
        make_problem: makes what is to be explained.
        known: how the targets are to be read, where that is known.
        effects: the catalogue.
        progress: called now and then.
        effort: how much is tried.
        first: called with what is to be explained and its plain fit, as soon as that is there.

    Returns:
        What is explained, and the explanation as `name_effects` has it.
    """
    problem = make_problem(known or "zero_order")
    effort = effort or Effort()

    def plain(one: Fit) -> None:
        if first is not None:
            first(problem, one)

    explanation = name_effects(problem, effects, progress, effort=effort, first=plain)
    at_floor = leaves_nothing(problem, explanation.fit)
    if known is not None or not explanation.searched or at_floor or _skips_targets(problem):
        return problem, explanation
    if not effort.allows("targets read otherwise between their samples"):
        return problem, replace(explanation, untried=tuple(effort.untried))
    others = [make_problem(one) for one in _OTHERS]
    flexible, *promised_by = _flexible_scores([problem, *others], explanation.fit)
    score = _score(problem, explanation)
    worst = max(flexible, score)
    for promised, other in sorted(zip(promised_by, others, strict=True), key=lambda one: one[0]):
        if worst - promised < _MARGIN:
            break
        found = name_effects(other, effects, progress, effort=effort)
        named = {one.term.effect.name for one in found.named}
        # Of the next row and late by as much is held, which the first search did not get right.
        undone = other.hold == "next" and not named.isdisjoint(_LATE)
        if _score(other, found) < score - _MARGIN and not undone:
            return other, found
    return problem, explanation


def _skips_targets(problem: Problem) -> bool:
    """Whether a step is longer than a sample, so that not all targets are ever held."""
    fastest = max(recording.rate for recording in problem.recordings)
    step = max(robot.model.opt.timestep for robot in problem.robots)
    return bool(step * fastest > _LONGER)


def _score(problem: Problem, explanation: Explanation) -> float:
    """How well what was named explains the recordings, in the light of its own numerical error."""
    problem.fit.refine(explanation.fit)
    one = explanation.fit
    return evaluate(problem.fit.objective, [(one.structure, one.values)])[0].score


def _flexible_scores(problems: Sequence[Problem], named: Fit) -> list[float]:
    """How well what was named explains each problem's recordings beside a drive that is free.

    Its friction, inertia, gains and bias. From what was named, as fits from nothing get stuck where
    much is missing, and would compare where they did; and from nothing, as what was named may stand
    in for other targets, and is in the way where these are right.
    """
    every, starts, races = [], [], []
    for problem in problems:
        beside = [_beside_a_free_drive(problem, named.structure, named.values)]
        if named.structure.terms:
            beside.append(_beside_a_free_drive(problem, problem.nothing, np.zeros(0)))
        for start in beside:
            problem.searched.look_at(start.case)
            every.append(problem)
            starts.append(start)
            races.append((problem.race.objective.apart(), problem.race.finer, start.case))
    refine(races)
    objectives = [objective for objective, *_ in races]
    fits = polished(
        objectives[0], starts, iterations=_FLEXIBLE_STEPS, certain=False, own=objectives
    )
    found: dict[int, float] = {}
    for problem, one in zip(every, fits, strict=True):
        problem.fit.refine(one)
        (own,) = evaluate(problem.fit.objective, [(one.structure, one.values)])
        found[id(problem)] = min(own.score, found.get(id(problem), np.inf))
    return [found[id(problem)] for problem in problems]


def _beside_a_free_drive(problem: Problem, known: Structure, values: FloatArray) -> Fit:
    """What was known and a drive whose numbers are free, to be fitted."""
    present = {term.effect.name for term in known.terms}
    wanted = [CATALOGUE[name] for name in _FLEXIBLE if name not in present]
    effects, _ = buildable(wanted, problem.robots, problem.joints)
    terms = problem.terms(effects)
    structure = Structure((*known.terms, *terms), problem.robots)
    return Fit(
        structure=structure,
        values=carried(values, known, structure),
        score=np.inf,
        mean_square=np.full(len(problem.channels), np.inf),
    )
