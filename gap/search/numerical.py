"""A simulation that is good enough: where most of a gap is numerical, the timestep is named first.

fit = as_simulated_well(problem, effects, nothing)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import Effect
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Case, Fit

FloatArray = NDArray[np.float64]

_LEFT_OF_THE_GAP = 0.6  # of a joint's, where most of it was numerical
_NEARLY_NOTHING = 0.1  # of all joints', where it was nothing else
_FAR_ABOVE, _OF_THE_MOTION = 10.0, 0.01  # of the noise, and of how far a joint moves


def as_simulated_well(problem: Problem, effects: Sequence[Effect], nothing: Fit) -> Fit:
    """The robot as it is, or in a simulation that is good enough for these recordings.

    The numerical error is taken out of every comparison. Where it is most of a joint's gap, far
    above the noise and a part of the motion that matters, it is an effect of its own, and the
    model is to be simulated otherwise. That has to show at the finest timestep, too, unless hardly
    anything is left, as of a log of another simulator: another integrator may stand in for what is
    really missing, as a drive's damping.
    """
    terms = [term for term in problem.terms(effects) if not term.effect.fitted]
    best = nothing
    for term in terms:
        structure = nothing.structure.with_term(term)
        magnitudes = zip(*(slot.parameter.starts for slot in structure.slots), strict=True)
        tries = Case(structure=structure, values=np.array(list(magnitudes)))
        # Little of the recordings shows whether there is anything of it.
        for objective in dict.fromkeys((problem.excerpt.objective, problem.fit.objective)):
            scores = _scores(problem, objective, nothing, tries)
            if not np.isfinite(scores).any():
                break
        else:
            values = tries.values[int(np.argmin(scores))]
            (best,) = evaluate(problem.fit.objective, [(structure, values)])
    return best


def _scores(problem: Problem, objective: Objective, nothing: Fit, tries: Case) -> FloatArray:
    """(n_tries,) scores of better simulations; infinity where what they take off is not enough."""
    before = objective.as_it_is([nothing.case])[0][0]
    before = np.where(np.isnan(before), np.inf, before)  # a model that diverges
    motion = np.nanstd(objective.measured, axis=0)
    of_position = np.array([channel.signal == "position" for channel in objective.channels])
    least = np.maximum(_FAR_ABOVE * problem.noise, _OF_THE_MOTION * motion)
    tried = objective.as_it_is([tries])[0]
    gained = np.sqrt(np.maximum(before - tried, 0.0)) > least
    most = (gained & (tried < _LEFT_OF_THE_GAP**2 * before) & of_position).any(axis=1)
    nearly_all = (tried < _NEARLY_NOTHING**2 * before)[:, of_position].all(axis=1)
    finest = tries.values[:, 0] == tries.values[:, 0].min()
    right = most & (nearly_all | most[finest].any())
    return np.where(right, objective.score(tried), np.inf)
