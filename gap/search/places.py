"""Places: an effect stays only at the joints or bodies that need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from walkerkit.gap.search.evidence import weigh
from walkerkit.gap.search.fit import Fit, evaluate, fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Structure, Term, carried
from walkerkit.gap.search.worth import worth_it

_REFITS = 4


def refit(problem: Problem, source: Fit, structures: Sequence[Structure]) -> list[Fit]:
    """Other structures, each raced from the values that it has in common with a fit."""
    objective = problem.race.objective
    starts = [(s, carried(source.values, source.structure, s)) for s in structures]
    return fit(objective, evaluate(objective, starts), iterations=_REFITS)


def places_needed(problem: Problem, full: Fit, term: Term) -> Fit:
    """The fit with one of its terms only at the places that need it.

    Args:
        problem: what is to be explained.
        full: the fit.
        term: one of its terms.

    Returns:
        A fit that keeps the term at one place at least.
    """
    while len(term.places) > 1:
        without = [
            replace(term, sites=tuple(other for other in term.sites if other != site))
            for site in term.sites
        ]
        fits = refit(problem, full, [_replaced(full.structure, term, t) for t in without])
        evidence = weigh(problem, [full, *fits])
        needless = [
            k for k in range(1, len(fits) + 1) if not worth_it(problem, evidence, 0, base=k)
        ]
        if not needless:
            break
        harm = evidence.both[1:] - evidence.both[0]
        kept = tuple(site for k, site in enumerate(term.sites, start=1) if k not in needless)
        if not kept:  # each can stand in for the others: the one that is missed most stays
            kept = (term.sites[int(np.argmax(harm))],)
        smaller = replace(term, sites=kept)
        (found,) = refit(problem, full, [_replaced(full.structure, term, smaller)])
        if len(needless) > 1 and worth_it(problem, weigh(problem, [found, full]), 1):
            # Together they are needed: drop only the one that is missed least.
            k = int(np.argmin(harm))
            smaller, found = without[k], fits[k]
        full, term = found, smaller
    return full


def _replaced(structure: Structure, old: Term, new: Term) -> Structure:
    terms = tuple(new if term is old else term for term in structure.terms)
    return Structure(terms, structure.robots)
