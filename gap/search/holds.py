"""Holds: what a log's targets are between their samples, and the effects named under that.

    problem, explanation = name_with_best_hold(make_problem, None, effects)

A drive holds its last command, but a log at the rate of the control loop itself is better read
between samples than held for a simulation that is faster than the loop. And a log may show at the
end of a period what was commanded in it. What was named tells which.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.search.buildable import buildable
from walkerkit.gap.search.effort import Effort, Progress
from walkerkit.gap.search.naming import Explanation, begin, explained, search
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import settled
from walkerkit.gap.search.slopes import Slopes, linearised
from walkerkit.gap.search.structure import Fit, extended
from walkerkit.gap.simulation.commands import Hold

_OTHERS: tuple[Hold, ...] = ("linear", "next")
_LONGER = 1.2  # samples in a step, which jitter does not make
_PASSES = 2  # of a fit with other targets
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
        first: called with what is to be explained and its plain fit to a few stretches.

    Returns:
        What is explained, and the explanation as `name_effects` has it.
    """
    problem, effort = make_problem(known or "zero_order"), effort or Effort()

    def plain(one: Fit) -> None:
        if first is not None:
            first(problem, one)

    begun = begin(problem, effects, progress, effort=effort, first=plain)
    found = search(problem, effects, progress, effort=effort, begun=begun)
    if known is None and begun.searched and not _skips_targets(problem):
        others = [make_problem(one) for one in _OTHERS]
        better = _better_read(problem, others, found.fit, effort)
        if better is not None:
            other = search(better, effects, progress, effort=effort)
            after, before = (
                one.fit.by_own_error(its.fit).score
                for one, its in ((better, other), (problem, found))
            )
            if after < before - _MARGIN:
                problem, found = better, other
    return problem, explained(problem, found, effort)


def _skips_targets(problem: Problem) -> bool:
    """Whether a step is longer than a sample, so that not all targets are ever held."""
    fastest = max(recording.rate for recording in problem.recordings)
    step = max(robot.model.opt.timestep for robot in problem.robots)
    return bool(step * fastest > _LONGER)


def _better_read(
    problem: Problem, others: Sequence[Problem], known: Fit, effort: Effort
) -> Problem | None:
    """Of the others the one whose targets suit what is known best; None where none is better.

    With all that is ordinary beside it, which may stand in for other targets.
    """
    if problem.leaves_nothing(known) or not effort.allows(
        "targets read otherwise between their samples"
    ):
        return None

    def fitted(one: Problem, start: Fit, near: Slopes | None = None, leader: float = np.inf) -> Fit:
        return settled(one.fit, start, near, passes=_PASSES, leader=leader, on_steps=False)

    problem.fit.refine(known)
    before = _beside_all_that_is_ordinary(problem, known)
    slopes: Slopes | None = linearised(problem.fit.objective, before)
    if before.structure.key == known.structure.key:
        before = problem.fit.by_own_error(before)
    else:
        before, slopes = fitted(problem, before, slopes), None
    better = before.score - _MARGIN
    found = [fitted(other, before, slopes, better) for other in others]
    best = int(np.argmin([one.score for one in found]))
    if found[best].score < better:
        # What it has found may be better with held targets, too.
        again = fitted(problem, found[best])
        if found[best].score < again.score - _MARGIN:
            return others[best]
    return None


def _beside_all_that_is_ordinary(problem: Problem, known: Fit) -> Fit:
    """What is known and all that every model has a little wrong, to be fitted.

    On feet each number takes simulations of its own: beside what was needed of all that, only what
    joints share (a delay) comes in.
    """
    present = {term.effect.name for term in known.structure.terms}
    ordinary = [e for e in CATALOGUE.values() if e.ordinary and e.name not in present]
    effects, _ = buildable(ordinary, problem.robots, problem.joints)
    terms = problem.terms(effects)
    return extended(known, [term for term in terms if term.shared or not problem.on_feet])
