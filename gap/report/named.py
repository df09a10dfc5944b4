"""The effects of an explanation as a diagnosis tells them: where, how sure, how large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.report.diagnosis import Considered, NamedEffect, Rival
from walkerkit.gap.report.estimates import estimates
from walkerkit.gap.report.replayed import Replayed, gaps_of, gaps_with
from walkerkit.gap.search.by_itself import fitted_alone, only_needed
from walkerkit.gap.search.certainty import covariance
from walkerkit.gap.search.compare import Member
from walkerkit.gap.search.naming import Explanation, in_its_place
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, Term, carried
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Robot


def named_effects(
    problem: Problem, explanation: Explanation, after: Replayed, mended: Sequence[Robot]
) -> tuple[NamedEffect, ...]:
    """The effects of an explanation, the surest first.

    Args:
        problem: what was explained.
        explanation: of it.
        after: the held-out recordings, replayed by the mended robots.
        mended: these robots.
    """
    final = explanation.fit
    if not final.structure.terms:
        return ()
    half = problem.whole if explanation.whole else problem.fit
    problem.searched.look_at(final.case)
    problem.screen.refine(final)
    half.refine(final)
    variance, sensitivity = covariance(
        half.objective, final, problem.noise, part=problem.screen.objective
    )
    terms = tuple(one.term for one in explanation.named)
    up_to_each = [_some(final, terms[:count]) for count in range(1, len(terms))]
    every = [*gaps_with(problem, up_to_each), gaps_of(after)]
    found = []
    for one, gaps in zip(explanation.named, every, strict=True):
        found.append(
            NamedEffect(
                effect=one.term.effect.name,
                joints=() if one.term.effect.kind == "body" else _shown_joints(one.term),
                bodies=one.term.sites if one.term.effect.kind == "body" else (),
                confidence=one.confidence,
                parameters=estimates(final, one.term, variance, sensitivity, mended, terms),
                gap_after=gaps["position"],
                gaps_after=gaps,
                indistinguishable_from=tuple(dict.fromkeys([*one.exchanges, *one.equivalent])),
                equivalent=tuple(one.equivalent.items()),
                share=one.lookalikes.share if one.lookalikes else np.nan,
                lookalikes=one.lookalikes.names if one.lookalikes else (),
            )
        )
    return tuple(found)


def confusion_set(problem: Problem, explanation: Explanation, most: int) -> list[Fit]:
    """Fits of the explanation, and of so many that could be in its place; empty for none.

    First come effects that these recordings happen not to tell apart. Where there are none, those
    follow that no recording of these channels could: other channels, or a changed set-up, may.
    What is in question is the last term of each fit.
    """
    for one in explanation.named:
        rivals = {id(m): (name, m) for name, m in reversed(one.exchanges.items())}.values()
        alone = [(name, _by_itself(problem, m)) for name, m in [*reversed(rivals)][:most]]
        # By itself a structure may need that effect no more.
        fits = [_last(fit, name) for name, fit in alone if _has(fit, name)]
        if fits:
            return [_last(explanation.fit, one.term.effect.name), *fits]
    for one in explanation.named:
        names = [*one.equivalent][:most]
        found = [in_its_place(problem, explanation, one.term, name) for name in names]
        others = [fit for fit in found if fit is not None]
        if others:
            return [_last(explanation.fit, one.term.effect.name), *others]
    return []


def rivals(problem: Problem, members: Sequence[Fit]) -> tuple[Rival, ...]:
    """What the robot may have instead: the members of a confusion set but the first."""
    found = []
    for fit in members[1:]:
        trials = [fit.structure.trials(robot, fit.values[None]) for robot in problem.robots]
        try:
            mended = [mend(one) for one in trials]
        except RuntimeError:  # the model's own settings undo this one
            continue
        n = len(fit.values)
        found.append(
            Rival(
                effect=fit.structure.terms[-1].effect.name,
                in_place_of=members[0].structure.terms[-1].effect.name,
                effects=tuple(
                    NamedEffect(
                        effect=term.effect.name,
                        joints=() if term.effect.kind == "body" else _shown_joints(term),
                        bodies=term.sites if term.effect.kind == "body" else (),
                        confidence=np.nan,
                        parameters=estimates(fit, term, np.zeros((n, n)), np.zeros(n), mended),
                        gap_after=np.nan,
                        indistinguishable_from=(),
                    )
                    for term in fit.structure.terms
                ),
            )
        )
    return tuple(found)


def _by_itself(problem: Problem, member: Member) -> Fit:
    """A member's fit, if it has nothing else."""
    alone = len(member.kept) == len(member.fit.values)
    return member.fit if alone else only_needed(problem, fitted_alone(problem, member))


def considered(explanation: Explanation) -> tuple[Considered, ...]:
    """Every effect that was tried, and what it would bring; those of the ground come first."""
    named = {one.term.effect.name for one in explanation.named}
    close = {name for one in explanation.named for name in one.exchanges}
    gains: Mapping[tuple[int, str], float] = explanation.gains
    return tuple(
        Considered(
            round=number,
            effect=name,
            improvement=float(1 - np.exp(-gain)),
            verdict="named" if name in named else "indistinguishable" if name in close else "lost",
        )
        for (number, name), gain in gains.items()
        if name in CATALOGUE
    )


def _has(fit: Fit, effect: str) -> bool:
    return any(term.effect.name == effect for term in fit.structure.terms)


def _last(fit: Fit, effect: str) -> Fit:
    """A fit whose last terms are those of an effect, where it has any."""
    terms = sorted(fit.structure.terms, key=lambda term: term.effect.name == effect)
    return _some(fit, tuple(terms))


def _some(final: Fit, terms: tuple[Term, ...]) -> Fit:
    """A fit with some of its terms, at the values that they have in it."""
    structure = Structure(terms, final.structure.robots)
    return Fit(
        structure=structure,
        values=carried(final.values, final.structure, structure),
        score=final.score,
        mean_square=final.mean_square,
    )


def _shown_joints(term: Term) -> tuple[str, ...]:
    return (EVERYWHERE,) if term.shared else term.sites
