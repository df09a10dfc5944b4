"""A structure of the table by itself: without what it does not need, or what of it is not known.

fit = fitted_alone(problem, member)
fit = only_needed(problem, fit)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.book import KnownErrors, stopped_at_a_bound, stopped_since
from walkerkit.gap.search.certainty import ran_away
from walkerkit.gap.search.compare import Member, leaves_smaller_gaps
from walkerkit.gap.search.decision import KNOWN, LEAST_GAIN
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.foretold import Foretold
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.reduce import Reduction
from walkerkit.gap.search.settle import PASSES, REFITS, robustly, settled
from walkerkit.gap.search.slopes import Slopes, linearised
from walkerkit.gap.search.structure import Fit, Structure, Term, Unit, carried, merged

FloatArray = NDArray[np.float64]

_KEEPS = 0.5  # of what slopes foretell, that has to come of it for them to be believed


def only_needed(problem: Problem, found: Fit) -> Fit:
    """A fit without what it does not need or cannot know.

    What it needs is read off slopes. Fitted, it may turn out to need even less, unless that leaves
    larger gaps: slopes do not know where the numerical error ends. And what of it is not known to
    be there, in the light of all that the model still lacks, is left out, unless a rare effect
    runs into its bound without it.

    Args:
        problem: what is explained.
        found: a member of the table by itself, `fitted_alone`.
    """
    objective, missed = problem.fit.objective, set[Unit]()
    problem.fit.refine(found)
    slopes, most = linearised(objective, found), found.score + LEAST_GAIN
    fuller: Fit | None = None  # which needs all that it has
    while found.structure.terms:
        reduction = Reduction(objective, found, slopes, problem.noise)
        smaller = reduction.best(few=True)
        if found is not fuller and len(smaller.kept) < len(found.values):
            fewer = by_itself(problem, smaller, slopes)
            if fewer.score <= most:
                found, slopes = fewer, linearised(objective, fewer)
                continue
            problem.fit.refine(found)
        fuller = found
        unknown, without = _not_known(problem, found, slopes, reduction.lost, missed)
        if without is not None:
            values = carried(found.values, found.structure, without)
            fewer = _settled(problem, found, without, values, slopes)
        elif unknown:
            fewer = by_itself(problem, reduction.best(unknown), slopes)
            if stopped_since(found, fewer):
                missed.update(unknown)
                problem.fit.refine(found)
                continue
        else:
            break
        most += max(0.0, fewer.score - found.score)
        found, slopes = fewer, linearised(objective, fewer)
    found, slopes = _without_the_idle(problem, found, slopes)
    return all_estimated(problem, robustly(problem.fit, found, slopes, problem.noise))


def fitted_alone(problem: Problem, member: Member) -> Fit:
    """A member fitted with its own numbers alone, to where wild blocks do not outvote the rest."""
    return _robust(problem, by_itself(problem, member))


def fitted_without(problem: Problem, one: Fit, gone: Collection[Term]) -> Fit:
    """A fit without some of its effects, as `fitted_alone`."""
    start = _left_out(one, gone)
    return _robust(problem, _settled(problem, one, start.structure, start.values, None))


def _robust(problem: Problem, found: Fit) -> Fit:
    return robustly(problem.fit, found, linearised(problem.fit.objective, found), problem.noise)


def _without_the_idle(problem: Problem, found: Fit, slopes: Slopes) -> tuple[Fit, Slopes]:
    """A fit without what, where slopes lead astray, is not worth a name once all else is refitted.

    Where feet come down a small change may have steep slopes, by which a number seems needed and
    known to a part in a hundred. Those that foretell more than comes of leaving it out are not
    believed; nor are any of what would be missed least. What leaves the smallest gaps is left out
    first, and all of it together is worth no name.
    """
    objective, tried, whole = problem.fit.objective, set[Unit](), slopes.residual
    while units := [*found.structure.units]:
        fewer = [found.structure.at({*units} - {unit}) for unit in units]
        starts = evaluate(
            objective, [(one, carried(found.values, found.structure, one)) for one in fewer]
        )
        foretold = Foretold(objective, slopes)
        here = foretold.score(np.zeros_like(found.values))
        least = min(start.score for start in starts)
        astray = [
            (unit, start)
            for unit, start in zip(units, starts, strict=True)
            if unit not in tried
            and (
                start.score == least
                or start.score - found.score < _KEEPS * (foretold.score(_out(found, unit)) - here)
            )
        ]
        for unit, start in sorted(astray, key=lambda one: one[1].score):
            tried.add(unit)
            without = settled(problem.fit, start, passes=PASSES, iterations=REFITS)
            its = linearised(objective, without)
            if not leaves_less(problem, its.residual, whole):
                found, slopes = without, its
                break
            problem.fit.refine(found)
        else:
            break
    return found, slopes


def leaves_less(problem: Problem, before: FloatArray, after: FloatArray) -> bool:
    """Whether gaps are smaller, by what is worth a name, where a residual is another.

    Args:
        problem: what is to be explained.
        before: (rows, n_scored) of what is fitted.
        after: the same, which is to be smaller.
    """
    objective = problem.fit.objective
    return leaves_smaller_gaps(
        objective.block_squares(before),
        objective.block_squares(after),
        count=objective.block_counts(),
        floor=problem.noise,
        joints=[channel.joint for channel in problem.channels],
    )


def _out(one: Fit, unit: Unit) -> FloatArray:
    """(n_parameters,) the step, in scales, that leaves an effect at a place out."""
    structure = one.structure
    own = [slot.unit == unit for slot in structure.slots]
    return np.where(own, (structure.zero - one.values) / structure.scale, 0.0)


def all_estimated(problem: Problem, found: Fit) -> Fit:
    """A fit without effects that are no estimate in it, unless others run into bounds without.

    What was known, and within its bounds, where wild blocks counted as the rest may be so no more
    where they do not.

    Args:
        problem: what is to be explained.
        found: the fit.
    """
    while terms := found.structure.terms:
        slopes = linearised(problem.fit.objective, found)
        gone = _no_estimates(problem, found, slopes, terms)
        if not gone:
            break
        start = _left_out(found, gone)
        without = _settled(problem, found, start.structure, start.values, slopes)
        if stopped_since(found, without):
            problem.fit.refine(found)
            break
        found = without
    return found


def without_stand_ins(problem: Problem, found: Fit, for_the_sake_of: Collection[str] = ()) -> Fit:
    """A fit, roughly, without rare effects that are no estimate in it.

    Those of which a number ran into its bound go first: of others it tells nothing.

    Args:
        problem: what is to be explained.
        found: the fit.
        for_the_sake_of: names of effects for which others are to leave. A fit of which none of
            these would be left is as good as it is.
    """
    objective = problem.fit.objective
    while terms := found.structure.rare:
        slopes = linearised(objective, found)
        gone = _no_estimates(problem, found, slopes, terms)
        left = {term.effect.name for term in terms if term not in gone}
        if not gone or (for_the_sake_of and left.isdisjoint(for_the_sake_of)):
            break
        start = _left_out(found, gone)
        (found,) = polished(objective, [start], slopes, iterations=REFITS)
    return found


def _left_out(one: Fit, gone: Collection[Term]) -> Fit:
    """A fit as it is without some effects, with the score that it has with them."""
    kept = tuple(term for term in one.structure.terms if term not in gone)
    fewer = replace(one.structure, terms=kept)
    return replace(one, structure=fewer, values=carried(one.values, one.structure, fewer))


def _no_estimates(problem: Problem, one: Fit, slopes: Slopes, terms: Sequence[Term]) -> list[Term]:
    """Effects of a fit that ran into a bound, or if none did those of which nothing is known."""
    return stopped_at_a_bound(one) or _of_which_nothing_is_known(problem, one, slopes, terms)


def _of_which_nothing_is_known(
    problem: Problem, one: Fit, slopes: Slopes, terms: Sequence[Term]
) -> list[Term]:
    """Those of some effects of which no number is known beside the others that stay."""
    fitted = [term for term in terms if len(one.structure.columns(term))]
    parts = [one.structure.columns(term) for term in fitted]
    return [fitted[k] for k in unknown_parts(KnownErrors(problem, one, slopes), parts)]


def unknown_parts(
    errors: KnownErrors, parts: Sequence[NDArray[np.int64]], lost: Sequence[float] | None = None
) -> list[int]:
    """Which parts of a fit are those of which no number is known beside the others that stay.

    Of these the one goes first that is missed least, or the least known where that is not given;
    how well the others are known without it is linear algebra.

    Args:
        errors: of the fit.
        parts: indices of the values of each.
        lost: by how much the score rises without each.
    """
    left, gone = [*range(len(parts))], list[int]()
    while left:
        each = errors.of(fixed=[k for part in gone for k in parts[part]])
        known = {part: float(each[parts[part]].max()) for part in left}
        unknown = [part for part in left if known[part] < KNOWN]
        if not unknown:
            break
        gone.append(min(unknown, key=known.__getitem__ if lost is None else lost.__getitem__))
        left.remove(gone[-1])
    return gone


def _not_known(
    problem: Problem,
    one: Fit,
    slopes: Slopes,
    lost: Mapping[Unit, float],
    missed: Collection[Unit],
) -> tuple[list[Unit], Structure | None]:
    """What of a fit is not known to be there.

    Args:
        problem: what is explained.
        one: the fit.
        slopes: those at it.
        lost: by how much the score rises without each of what it has.
        missed: what has to stay.

    Returns:
        Of the ordinary effects of each place that are not known the one without which least is
        lost; and the structure without rare ones where they are not known, if there are any.
    """
    structure, errors = one.structure, KnownErrors(problem, one, slopes)
    rare = {(t.effect.name, p): structure.columns(t, p) for t in structure.rare for p in t.places}
    # What ran into a bound is no estimate, and what ends there is none of the rest.
    stopped = ran_away(one)
    gone = [unit for unit, own in rare.items() if stopped[own].any()]
    units, missing = [*rare], [lost.get(unit, np.inf) for unit in rare]
    gone = gone or [units[k] for k in unknown_parts(errors, [*rare.values()], missing)]
    if gone:
        return [], structure.at(structure.units.keys() - {*gone})
    each = errors.of()
    least: dict[str, tuple[float, str]] = {}
    for term in structure.terms:
        for place in term.places if term.effect.ordinary else ():
            unit = term.effect.name, place
            if unit not in missed and each[structure.columns(term, place)].max() < KNOWN:
                least[place] = min(least.get(place, (np.inf, "")), (lost[unit], unit[0]))
    return [(name, place) for place, (_, name) in least.items()], None


def by_itself(problem: Problem, member: Member, near: Slopes | None = None) -> Fit:
    """A member fitted in the light of its own numerical error, from what slopes say of it."""
    structure, whole = _of_kept(member), member.fit.structure
    values = carried(member.values, whole, structure)
    return _settled(problem, member.fit, structure, values, near)


def _settled(
    problem: Problem, source: Fit, structure: Structure, values: FloatArray, near: Slopes | None
) -> Fit:
    start = replace(source, structure=structure, values=np.clip(values, *structure.bounds))
    return settled(problem.fit, start, near, passes=PASSES, iterations=REFITS)


def _of_kept(member: Member) -> Structure:
    return merged(member.fit.structure.at(member.units))
