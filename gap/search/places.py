"""Places: an effect stays only at the joints or bodies that need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from walkerkit.gap.search.evidence import weigh
from walkerkit.gap.search.fit import evaluate, fit, polished
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.slopes import Slopes, linearised, losses, slopes_to_carry
from walkerkit.gap.search.structure import Fit, Structure, Term, carried
from walkerkit.gap.search.worth import least_gain, worth_it

_REFITS = 4
_SURE = 5.0  # of the least gain; a place that loses more by the slopes is needed


def refit(
    problem: Problem, source: Fit, structures: Sequence[Structure], slopes: Slopes | None = None
) -> list[Fit]:
    """Other structures, each raced from the values that it has in common with a fit.

    Args:
        problem: what is to be explained.
        source: the fit.
        structures: the others.
        slopes: of the fit in the race, where they are known.
    """
    if not structures:
        return []
    objective = problem.race.objective
    starts = evaluate(
        objective, [(s, carried(source.values, source.structure, s)) for s in structures]
    )
    if slopes is None:
        slopes = slopes_to_carry(objective, source)
    if len(starts) > 1:
        return fit(objective, starts, iterations=_REFITS, near=slopes)
    return polished(objective, starts, slopes, iterations=_REFITS, certain=False)


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
        slopes = linearised(problem.race.objective, full)
        loss = _losses(problem, full, term, slopes)
        sure = _SURE * least_gain(problem) / len(problem.channels)
        doubtful = [site for site in term.places if loss[site] < sure]
        if len(doubtful) == len(term.places):
            doubtful.remove(max(term.places, key=loss.__getitem__))
        if not doubtful:
            break
        smaller, found = _dropped(problem, full, term, doubtful, slopes)
        if _spared(problem, full, found):
            return found
        if len(doubtful) == 1:
            break
        # Some of them are needed.
        without = [_without(term, [site]) for site in doubtful]
        others = [full.structure.replaced(term, t) for t in without]
        fits = refit(problem, full, others, slopes)
        evidence = weigh(problem, [full, *fits])
        needless = [k for k in range(len(fits)) if not worth_it(problem, evidence, 0, base=k + 1)]
        if not needless:
            break
        least = min(needless, key=lambda k: evidence.both[k + 1])
        smaller, found = without[least], fits[least]
        if 1 < len(needless) < len(doubtful):
            together = _dropped(problem, full, term, [doubtful[k] for k in needless], slopes)
            if _spared(problem, full, together[1]):
                smaller, found = together
        full, term = found, smaller
    return full


def _losses(problem: Problem, full: Fit, term: Term, slopes: Slopes) -> dict[str, float]:
    """Place of a term to what dropping it costs of the score, by the slopes, or as it is.

    Slopes do not see that a limit which nothing reaches may as well be far away.
    """
    objective, structure = problem.race.objective, full.structure
    lost = losses(objective, full, slopes)
    smaller = [structure.replaced(term, _without(term, [site])) for site in term.places]
    now, *without = evaluate(
        objective,
        [(one, carried(full.values, structure, one)) for one in (structure, *smaller)],
    )
    return {
        site: min(float(lost[structure.columns(term, site)].min()), one.score - now.score)
        for site, one in zip(term.places, without, strict=True)
    }


def _dropped(
    problem: Problem, full: Fit, term: Term, sites: Sequence[str], slopes: Slopes
) -> tuple[Term, Fit]:
    smaller = _without(term, sites)
    (found,) = refit(problem, full, [full.structure.replaced(term, smaller)], slopes)
    return smaller, found


def _spared(problem: Problem, full: Fit, smaller: Fit) -> bool:
    """Whether a fit is not worth it over one with fewer places."""
    return not worth_it(problem, weigh(problem, [smaller, full]), 1)


def _without(term: Term, sites: Sequence[str]) -> Term:
    return replace(term, sites=tuple(site for site in term.sites if site not in sites))
