"""Starts of rare effects on the model as given, where nothing ordinary stands in for them.

    for structure, values in afresh(problem.screen, current, terms, most=4): ...

What is ordinary may have bent itself far to follow a rare effect, so that beside it this promises
nothing any more: a servo's gains follow a late loop, and damping below zero follows friction that
falls with speed. On the model as given such an effect by itself leaves less than others do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.signatures import tries_of
from walkerkit.gap.search.structure import Fit, Structure, Term, carried

FloatArray = NDArray[np.float64]


def afresh(
    half: Half, current: Fit, terms: Sequence[Term], *, most: int
) -> list[tuple[Structure, FloatArray]]:
    """Where the effects begin that leave least by themselves.

    Each magnitude is simulated at all places at once; each place takes the one that leaves least in
    its own channels, or stays without the effect where none leaves less than the model as given.

    Args:
        half: the recordings that are looked at.
        current: a fit of what is ordinary, and of what came with it, which is left out.
        terms: rare effects. What all joints share is also tried with a value for each.
        most: of them that begin.

    Returns:
        Structures that have all that is ordinary, too, with that at its zero.
    """
    objective, given = half.objective, as_given(current)
    apart = [replace(term, shared=False) for term in terms if term.shared and len(term.sites) > 1]
    tries = [tries_of(given, term) for term in (*terms, *apart)]
    own, *found = objective.mean_squares([given.case, *(one.at_once(given) for one in tries)])
    joints = [channel.joint for channel in objective.channels]
    left = 0.5 * np.log(own[0] + objective.level**2)
    starts = []
    for one, squares in zip(tries, found, strict=True):
        gained = left - 0.5 * np.log(squares + objective.level**2)
        chosen: dict[str, FloatArray] = {}
        for place in dict.fromkeys(one.places):
            here = [k for k, other in enumerate(one.places) if other == place]
            mine = [joint == place for joint in joints]
            merit = np.nan_to_num(gained[: len(here), mine if any(mine) else slice(None)], nan=-1.0)
            merit = merit.sum(axis=1)
            if merit.max() > 0:
                chosen[place] = one.values[here[int(np.argmax(merit))]]
        if chosen:
            starts.append(_start(given, one.term, chosen))
    return that_leave_least(objective, starts, most)


def that_leave_least(
    objective: Objective, starts: Sequence[tuple[Structure, FloatArray]], most: int
) -> list[tuple[Structure, FloatArray]]:
    """So many starts with the smallest scores, the smallest first."""
    begun = evaluate(objective, starts)
    order = sorted(range(len(starts)), key=lambda k: begun[k].score)
    return [starts[k] for k in order[:most]]


def as_given(current: Fit) -> Fit:
    """The model as given, with the ordinary numbers of a fit at their zeros."""
    ordinary = tuple(term for term in current.structure.terms if term.effect.ordinary)
    plain = replace(current.structure, terms=ordinary)
    return replace(current, structure=plain, values=plain.zero)


def _start(given: Fit, term: Term, chosen: dict[str, FloatArray]) -> tuple[Structure, FloatArray]:
    """One effect where it leaves less, on top of the model as given."""
    if not term.shared:
        term = replace(term, sites=tuple(site for site in term.sites if site in chosen))
    structure = given.structure.with_term(term)
    values = carried(given.values, given.structure, structure)
    for place, own in chosen.items():
        values[structure.columns(term, place)] = own
    return structure, values
