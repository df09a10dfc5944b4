"""The ground: what every model has a little wrong, fitted before any rare effect is looked for.

    start = ground(problem, effects)      # damping, dry friction, armature, servo gains, one delay

Every structure that is compared stands on it. Its numbers are shrunk to zero by their priors where
the recordings do not want them, so that it uses up no name.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.fit import Progress, settled
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, carried

_PASSES = 2  # of fitting and finding the numerical error again


def ground(
    problem: Problem,
    effects: Sequence[Effect],
    nothing: Fit,
    progress: Progress | None = None,
) -> Fit:
    """Fits all ordinary effects at all joints together.

    Args:
        problem: what is to be explained.
        effects: the catalogue; its ordinary effects are the ground.
        nothing: what they come on top of.
        progress: called before each step.

    Returns:
        Their most probable values, on all recordings that are fitted.
    """
    ordinary = [effect for effect in effects if effect.ordinary]
    terms = problem.terms(ordinary)
    if not terms:
        return nothing
    structure = Structure((*nothing.structure.terms, *terms), problem.robots)
    found = Fit(
        structure=structure,
        values=carried(nothing.values, nothing.structure, structure),
        score=np.inf,
        mean_square=np.full(len(problem.channels), np.inf),
    )
    problem.searched.look_at(nothing.case)
    for half, passes in ((problem.screen, 1), (problem.race, 1), (problem.fit, _PASSES)):
        found = settled(half, found, passes=passes, progress=progress, stage="ordinary effects")
    return found
