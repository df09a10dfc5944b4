"""The ground: what every model has a little wrong, fitted before any rare effect is looked for.

    start = ground(problem, effects)      # damping, dry friction, armature, servo gains, one delay

Every structure that is compared stands on it. Its numbers are shrunk to zero by their priors where
the recordings do not want them, so that it uses up no name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect, Parameter
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.search.fit import best_of, evaluate, polished
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.like_joints import tied
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.on_feet import on_feet
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.settle import robustly_settled
from walkerkit.gap.search.structure import Case, Fit, Slot, Structure, Term, carried, extended
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_STEPS, _FIRST_STEPS = 8, 4  # of a fit to a part, the most, and up to the first answer
_FACTORS = (0.01, 0.1, 10.0, 100.0)  # on servo gains, that a fit may begin with
_FINER = 5  # steps of delays in one that is as long as their scale
_PASSES = 2  # of fitting and finding the numerical error again
_STAGE = "ordinary effects"


def ground(
    problem: Problem,
    effects: Sequence[Effect],
    nothing: Fit,
    progress: Progress | None = None,
    first: Callable[[Fit], None] | None = None,
) -> Fit:
    """Fits all ordinary effects at all joints together.

    Args:
        problem: what is to be explained.
        effects: the catalogue; its ordinary effects are the ground.
        nothing: what they come on top of.
        progress: called before each step.
        first: called with their values on a few stretches, which are there in seconds.

    Returns:
        Their most probable values, on all recordings that are fitted; of a floating base with what
        that and the ground under it need besides.
    """
    ordinary = [effect for effect in effects if effect.ordinary]
    terms = problem.terms(ordinary)
    if not terms:
        return nothing
    found = extended(nothing, terms)
    problem.searched.look_at(nothing.case)
    few = tied(found.structure) if problem.on_feet else None
    found = _with_gains_of_any_size(problem.screen, found)
    if few is not None:
        return on_feet(problem, effects, few, found, progress=progress, first=first)
    for part in problem.parts:
        found, first = _fitted_to_a_part(part, found, progress, first), None
    found = robustly_settled(
        *(problem.fit, found, problem.noise), passes=_PASSES, progress=progress, stage=_STAGE
    )
    if first is not None:
        first(found)
    return found


def _with_gains_of_any_size(part: Half, start: Fit) -> Fit:
    """Where a fit begins: with servo gains that may be off by orders of magnitude.

    A fit would come there in many steps, or not at all, as a servo that is a hundred times too soft
    lets the robot hang. All joints are tried at once, with kp alone and with kd in proportion; each
    may begin with what its own channels like best.
    """
    objective, structure = part.objective, start.structure
    own = {
        k: gain
        for k, slot in enumerate(structure.slots)
        if slot.term.effect.part == "gain" and (gain := _given(slot, structure.robots))
    }
    if not own:
        return start
    values = np.tile(start.values, (1 + 2 * len(_FACTORS), 1))
    for n, factor in enumerate(_FACTORS, start=1):
        for k, gain in own.items():
            values[n + len(_FACTORS), k] = (factor - 1) * gain
            if structure.slots[k].term.effect.name == "position_gain":
                values[n, k] = (factor - 1) * gain
    case = Case(structure=structure, values=np.clip(values, *structure.bounds))
    (mean_square,) = objective.mean_squares([case])
    liked = np.nan_to_num(np.log(mean_square + objective.level**2), nan=np.inf)
    joints = np.array([channel.joint or "" for channel in objective.channels])
    each = start.values.copy()
    for k in own:
        mine = liked[:, joints == structure.slots[k].place]
        each[k] = case.values[int(np.argmin(mine.sum(axis=1))), k]
    best, _ = objective.best(case, mean_square)
    return min([best, *evaluate(objective, [(structure, each)])], key=lambda one: one.score)


def _given(slot: Slot, robots: Sequence[Robot]) -> float:
    """What the models have of a number, on average; 0 of one that is in none of their files."""
    field = slot.term.effect.fields.get(slot.parameter.name)
    if field is None:
        return 0.0
    return float(np.mean([field.read(robot, slot.place, robot) or 0.0 for robot in robots]))


def _fitted_to_a_part(
    part: Half, start: Fit, progress: Progress | None, first: Callable[[Fit], None] | None
) -> Fit:
    """A fit to little of the recordings; the first answer is that of a few steps as simulated."""

    def improved(one: Fit, steps: int = _STEPS) -> Fit:
        (found,) = polished(
            part.objective,
            [one],
            iterations=steps,
            near_enough=True,
            progress=progress,
            stage=_STAGE,
        )
        return found

    found = start
    if first is not None:
        found = improved(start, _FIRST_STEPS)
        first(found)
    part.refine(start)
    return _delays_by_themselves_too(part.objective, improved, start, found)


def _delays_by_themselves_too(
    objective: Objective, improved: Callable[[Fit], Fit], start: Fit, further: Fit
) -> Fit:
    """The best fit of all at once: from further on, and from a start with delays last, or first.

    A delay stands in for friction and gains where it is let loose with them, and may not come back;
    and so may they for a delay, which is better by itself then.
    """
    structure, found = start.structure, improved(further)
    late = [t for t in structure.terms if any(p.is_delay for p in _parameters(structure, t))]
    prompt = [t for t in structure.terms if t not in late]
    if not (late and prompt):
        return found

    def on(other: Structure, one: Fit) -> Fit:
        values = carried(one.values, one.structure, other)
        return replace(start, structure=other, values=values)

    def of_some(terms: Sequence[Term]) -> Fit:
        return on(replace(structure, terms=tuple(terms)), start)

    def of_all(some: Fit) -> Fit:
        return improved(on(structure, some))

    found = min(found, of_all(improved(of_some(prompt))), key=lambda one: one.score)
    delays = improved(_of_any_length(objective, of_some(late)))
    if delays.score < found.score:
        found = min(found, of_all(delays), key=lambda one: one.score)
    return found


def _of_any_length(objective: Objective, delays: Fit) -> Fit:
    """The best of delays as they are and others that are all alike.

    They are tried in steps of their scale and then in smaller ones: a stiff servo is at its limit
    wherever targets are off by more than a little, so that slopes do not lead there.
    """
    structure = delays.structure
    (lower, upper), scale = structure.bounds, structure.scale
    alike = np.arange(np.floor(np.min(lower / scale)), np.max(upper / scale) + 1)[:, None] * scale
    near = np.arange(1 - _FINER, _FINER)[:, None] * scale / _FINER
    tried = np.concatenate([delays.values[None], alike])
    for _ in range(2):
        case = Case(structure=structure, values=np.clip(tried, lower, upper))
        (best,) = best_of(objective, [case])
        tried = best.values + near
    return best


def _parameters(structure: Structure, term: Term) -> list[Parameter]:
    return [structure.slots[k].parameter for k in structure.columns(term)]
