"""The effects that a search has named: where, how sure, what they cannot be told from."""

from __future__ import annotations

from collections.abc import Sequence

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.report.diagnosis import NamedEffect
from walkerkit.gap.report.estimates import estimates
from walkerkit.gap.report.replayed import Replayed, gaps_of, gaps_with
from walkerkit.gap.search.certainty import covariance
from walkerkit.gap.search.naming import Candidate, Round
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Term
from walkerkit.gap.simulation.robot import Robot

_AS_GOOD = 0.05  # of the score: one that was tried and stayed further behind is not the same


def named_effects(
    problem: Problem, rounds: Sequence[Round], after: Replayed, mended: Sequence[Robot]
) -> tuple[NamedEffect, ...]:
    """The terms of the final structure, with the round that named each.

    Args:
        problem: what was explained.
        rounds: the search.
        after: the held-out recordings, replayed by the mended robots.
        mended: these robots.
    """
    final = rounds[-1].fit
    if not final.structure.terms:
        return ()
    half = problem.whole if rounds[-1].whole else problem.fit
    problem.searched.look_at(final.case)
    problem.screen.refine(final)
    variance, sensitivity = covariance(
        half.objective, final, problem.noise, part=problem.screen.objective
    )
    found = []
    for count, term in enumerate(final.structure.terms, start=1):
        one = _round_of(term, rounds)
        last = count == len(final.structure.terms)
        gaps = gaps_of(after) if last else gaps_with(problem, one.fit)
        rivals = [fit.structure.terms[-1].effect.name for fit in rivals_of(one, final)]
        equivalent = _equivalent(problem, term, one, final)
        found.append(
            NamedEffect(
                effect=term.effect.name,
                joints=() if term.effect.kind == "body" else _shown_joints(term),
                bodies=term.sites if term.effect.kind == "body" else (),
                confidence=one.confidence,
                parameters=estimates(final, term, variance, sensitivity, mended),
                gap_after=gaps["position"],
                gaps_after=gaps,
                indistinguishable_from=tuple(dict.fromkeys([*rivals, *equivalent])),
                equivalent=tuple(equivalent.items()),
            )
        )
    return tuple(found)


def confusion_set(rounds: Sequence[Round], most: int) -> list[Fit]:
    """The fits of the first effect that has rivals, and of so many of these; empty for none.

    Each is in the company of the same other effects, with the one in question last.
    """
    final = rounds[-1].fit
    for term in final.structure.terms:
        one = _round_of(term, rounds)
        own = [c.fit for c in one.candidates if c.term.effect is term.effect]
        rivals = rivals_of(one, final)
        if own and rivals:
            return [own[0], *rivals[:most]]
    return []


def rivals_of(one: Round, final: Fit) -> list[Fit]:
    """Fits that explained as well as the one that a round named, and were not named after it."""
    present = _names(final)
    return [
        candidate.fit
        for candidate in one.candidates
        if candidate.close and candidate.term.effect.name not in present
    ]


def _equivalent(problem: Problem, term: Term, one: Round, final: Fit) -> dict[str, str]:
    """What is exactly the same as a term with these channels, by name, with the reason."""
    sites = set(term.sites)
    signals = {
        channel.signal
        for channel in problem.channels
        if term.effect.kind != "joint" or channel.joint in sites
    }
    present = _names(final)
    known = equivalences(
        term.effect.name,
        signals,
        robot=problem.robots[0],
        joints=() if term.effect.kind == "body" else _shown_joints(term),
        beside={
            other.effect.name
            for other in final.structure.terms
            if other is not term and (EVERYWHERE in other.sites or sites <= {*other.sites})
        },
    )
    tried = {candidate.term.effect.name: candidate for candidate in one.candidates}
    best = tried.get(term.effect.name)

    def possible(name: str) -> bool:
        # Steps of a simulation part delays that no log can part.
        both_delays = term.effect.part == CATALOGUE[name].part == "timing"
        return both_delays or _as_good(tried.get(name), best)

    return {
        name: reason
        for name, reason in known.items()
        if name in CATALOGUE and name not in present and possible(name)
    }


def _as_good(candidate: Candidate | None, best: Candidate | None) -> bool:
    """Whether what was tried does not speak against it."""
    return (
        candidate is None
        or best is None
        or candidate.close
        or candidate.gain > best.gain - _AS_GOOD
    )


def _names(fit: Fit) -> set[str]:
    return {term.effect.name for term in fit.structure.terms}


def _round_of(term: Term, rounds: Sequence[Round]) -> Round:
    return next(one for one in rounds if one.named is term)


def _shown_joints(term: Term) -> tuple[str, ...]:
    return (EVERYWHERE,) if term.shared else term.sites
