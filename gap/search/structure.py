"""A structure: which effects are added, at which sites; its values are a plain vector.

structure = Structure(terms=(Term(effect=CATALOGUE["armature"], sites=("knee",)),), robots=robots)
trials = structure.trials(robot, values)      # values (n, n_parameters)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import EVERYWHERE, Effect, Parameter
from walkerkit.gap.search.decision import TAILS
from walkerkit.gap.simulation.branches import branches
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
Unit = tuple[str, str]  # an effect and one of its places


@dataclass(frozen=True, kw_only=True)
class Term:
    """One effect at some sites.

    Attributes:
        effect: the effect.
        sites: joints or bodies, or `("*",)`.
        shared: one value for all sites instead of one each.
        doubted: the sites at which nobody knows its size, so that any is plausible.
    """

    effect: Effect
    sites: tuple[str, ...]
    shared: bool = False
    doubted: frozenset[str] = frozenset()

    @property
    def places(self) -> tuple[str, ...]:
        """Where each set of parameters belongs: the sites, or `*` for a shared one."""
        return (EVERYWHERE,) if self.shared else self.sites

    def doubts(self, place: str) -> bool:
        """Whether any size is plausible at a place."""
        return self.doubted.issuperset(self.sites if self.shared else (place,))


@dataclass(frozen=True, kw_only=True)
class Slot:
    """One number of a structure: a parameter of a term at a place."""

    term: Term
    place: str
    parameter: Parameter

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is in any structure."""
        return (*self.unit, self.parameter.name)

    @property
    def unit(self) -> Unit:
        """The effect and the place that it is a number of."""
        return self.term.effect.name, self.place


@dataclass(frozen=True)
class Structure:
    """Effects added to some robots that share the effects' values.

    Attributes:
        terms: what is added, in order.
        robots: the robots; bounds are those that suit all of them.
    """

    terms: tuple[Term, ...]
    robots: tuple[Robot, ...]

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """The structure's numbers, in the order of its values."""
        return tuple(
            Slot(term=term, place=place, parameter=parameter)
            for term in self.terms
            for place in term.places
            for parameter in self._parameters(term, term.sites[0] if term.shared else place)
        )

    def _parameters(self, term: Term, site: str) -> tuple[Parameter, ...]:
        """Parameters that suit all robots."""
        per_robot = [term.effect.parameters(robot, site) for robot in self.robots]
        return tuple(_common(same) for same in zip(*per_robot, strict=True))

    @property
    def key(self) -> tuple[tuple[str, tuple[str, ...], bool], ...]:
        """Its terms by name, site, and whether they are shared, in order."""
        return tuple((term.effect.name, term.sites, term.shared) for term in self.terms)

    @cached_property
    def units(self) -> dict[Unit, NDArray[np.intp]]:
        """Each effect at each of its places, in order, to the indices of its numbers there."""
        return {
            (term.effect.name, place): self.columns(term, place)
            for term in self.terms
            for place in term.places
        }

    def at(self, units: Collection[Unit]) -> Structure:
        """The structure with its effects at some of their places alone, (name, place) each."""
        terms = []
        for term in self.terms:
            places = tuple(p for p in term.places if (term.effect.name, p) in units)
            if places:
                terms.append(term if term.shared else replace(term, sites=places))
        return replace(self, terms=tuple(terms))

    @property
    def rare(self) -> tuple[Term, ...]:
        """The terms of effects that not every model has a little wrong, and that are fitted."""
        return tuple(t for t in self.terms if t.effect.fitted and not t.effect.ordinary)

    @property
    def rare_names(self) -> frozenset[str]:
        """Names of those effects."""
        return frozenset(term.effect.name for term in self.rare)

    @cached_property
    def zero(self) -> FloatArray:
        """(n_parameters,) values at which the robots are unchanged."""
        return np.array([slot.parameter.zero for slot in self.slots])

    @cached_property
    def scale(self) -> FloatArray:
        """(n_parameters,) typical sizes."""
        return np.array([slot.parameter.scale for slot in self.slots])

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (n_parameters,) each."""
        return (
            np.array([slot.parameter.lower for slot in self.slots]),
            np.array([slot.parameter.upper for slot in self.slots]),
        )

    @cached_property
    def prior(self) -> FloatArray:
        """(n_parameters,) widths about `zero` of the priors; infinite where any size is as good."""
        return np.array(
            [np.inf if s.term.doubts(s.place) else s.parameter.prior for s in self.slots]
        )

    def away(self, values: FloatArray) -> FloatArray:
        """(..., n_parameters) distances from zero, in widths of the priors."""
        found: FloatArray = (values - self.zero) / self.prior
        return found

    def surprise(self, values: FloatArray) -> FloatArray:
        """(..., n_parameters) values → the same, what the size of each costs: log odds against it.

        Normal near zero, with the tails of the comparison: what is many times as large as is
        plausible is drawn to it the less, the larger it is.
        """
        found: FloatArray = 0.5 * TAILS * np.log1p(self.away(values) ** 2 / TAILS)
        return found

    def prior_curvature(self, values: FloatArray) -> FloatArray:
        """(n_parameters,) of the normal priors that are as steep as these at some values.

        In units of the parameters' scales; unlike the curvature itself it is never negative.
        """
        found: FloatArray = (
            (self.scale / self.prior) ** 2 * TAILS / (TAILS + self.away(values) ** 2)
        )
        return found

    @cached_property
    def branches(self) -> tuple[int | None, ...]:
        """(n_parameters,) the only branch of the robots that each number can change, or None."""
        if any(term.effect.kind == "robot" for term in self.terms):
            return (None,) * len(self.slots)  # the voltage of a supply couples the drives
        per_robot = [branches(robot) for robot in self.robots]
        if any(found != per_robot[0] for found in per_robot):
            return (None,) * len(self.slots)
        of_joint, of_body = per_robot[0]
        return tuple(
            (of_joint if slot.term.effect.kind == "joint" else of_body).get(slot.place)
            for slot in self.slots
        )

    def with_term(self, term: Term) -> Structure:
        """The structure with one more term at its end."""
        return Structure((*self.terms, term), self.robots)

    def without_term(self, term: Term) -> Structure:
        """The structure without one of its terms."""
        return Structure(tuple(t for t in self.terms if t is not term), self.robots)

    def replaced(self, old: Term, new: Term) -> Structure:
        """The structure with another term in place of one of its terms."""
        return Structure(tuple(new if t is old else t for t in self.terms), self.robots)

    def columns(self, term: Term, place: str | None = None) -> NDArray[np.int64]:
        """Indices of the values of a term, or of a term at one of its places."""
        return np.array(
            [
                i
                for i, slot in enumerate(self.slots)
                if slot.term is term and place in (None, slot.place)
            ],
            dtype=np.int64,
        )

    def trials(self, robot: Robot, values: FloatArray) -> Trials:
        """The variants of a robot that these values make.

        Args:
            robot: one of the robots, or one with the same joints and bodies.
            values: (n, n_parameters).

        Returns:
            n trials.
        """
        trials = Trials(robot, len(values))
        for term in self.terms:
            for site in term.sites:
                columns = self.columns(term, EVERYWHERE if term.shared else site)
                given = values[:, columns]
                # Robots differ in what leaves them unchanged, such as the limits they have.
                own = [parameter.zero for parameter in term.effect.parameters(robot, site)]
                term.effect.apply(trials, site, np.where(given == self.zero[columns], own, given))
        return trials


def _common(same: Sequence[Parameter]) -> Parameter:
    """One parameter of several robots: the tightest bounds of all, sized on the first."""
    first = same[0]
    lower, upper = max(p.lower for p in same), min(p.upper for p in same)
    if not lower < upper:  # robots that moved far apart
        return first

    def inside(value: float) -> float:
        return min(max(value, lower), upper)

    return replace(
        first,
        zero=inside(first.zero),
        lower=lower,
        upper=upper,
        starts=tuple(inside(start) for start in first.starts),
        end=next((end for end in (lower, upper) if end in {p.end for p in same}), None),
    )


def carried(values: FloatArray, source: Structure, target: Structure) -> FloatArray:
    """Values of one structure as the start of another: what both have is kept, the rest is zero.

    Args:
        values: (n_parameters of source,).
        source: where the values belong.
        target: the other structure.

    Returns:
        (n_parameters of target,).
    """
    known = {slot.key: value for slot, value in zip(source.slots, values, strict=True)}
    shared = {(name, p): v for (name, place, p), v in known.items() if place == EVERYWHERE}
    return np.array(
        [
            known.get(
                slot.key,
                shared.get((slot.term.effect.name, slot.parameter.name), slot.parameter.zero),
            )
            for slot in target.slots
        ]
    )


def found_in(structure: Structure, other: Structure) -> NDArray[np.intp]:
    """(n_parameters,) index of each number among those of another structure; -1 for a new one."""
    known = {slot.key: k for k, slot in enumerate(other.slots)}
    return np.array([known.get(slot.key, -1) for slot in structure.slots], dtype=np.intp)


def merged(structure: Structure) -> Structure:
    """The structure with the terms of each effect made one, at the place of the first."""
    terms: dict[str, Term] = {}
    for term in structure.terms:
        known = terms.get(term.effect.name)
        if known is not None:
            sites = {*known.sites, *term.sites}
            robot = structure.robots[0]
            order = [*robot.joints, *robot.bodies, EVERYWHERE]
            term = replace(known, sites=tuple(sorted(sites, key=order.index)))
        terms[term.effect.name] = term
    return Structure(tuple(terms.values()), structure.robots)


def extended(one: Fit, terms: Sequence[Term]) -> Fit:
    """A fit with further terms, which change nothing yet, to be fitted."""
    structure = Structure((*one.structure.terms, *terms), one.structure.robots)
    return Fit(
        structure=structure,
        values=carried(one.values, one.structure, structure),
        score=np.inf,
        mean_square=np.full(len(one.mean_square), np.inf),
    )


def candidate_terms(
    effects: Sequence[Effect], robots: Sequence[Robot], joints: Sequence[str]
) -> tuple[Term, ...]:
    """Every effect at all sites where it could act on all robots."""
    terms = []
    for effect in effects:
        per_robot = [effect.sites(robot, joints) for robot in robots]
        sites = tuple(site for site in per_robot[0] if all(site in other for other in per_robot))
        if sites:
            shared = effect.shared and len(sites) > 1
            terms.append(Term(effect=effect, sites=sites, shared=shared))
    return tuple(terms)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Some values of a structure, to be simulated.

    Attributes:
        structure: the structure.
        values: (n, n_parameters).
        start_errors: joint to (n, 2) as `Trials` has them; none by default.
    """

    structure: Structure
    values: FloatArray
    start_errors: Mapping[str, FloatArray] = field(default_factory=dict)

    def trials(self, robot: Robot) -> Trials:
        """The variants of a robot that the values make."""
        trials = self.structure.trials(robot, self.values)
        for joint, errors in self.start_errors.items():
            trials.start_errors[joint] += errors
        return trials


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A structure with its fitted values.

    Attributes:
        structure: the structure.
        values: (n_parameters,).
        score: its score on the recordings that were fitted.
        mean_square: (n_scored,) mean square gaps on them.
    """

    structure: Structure
    values: FloatArray
    score: float
    mean_square: FloatArray

    @property
    def case(self) -> Case:
        """Its values, to be simulated."""
        return Case(structure=self.structure, values=self.values[None])
