"""A structure that was given, fitted: its parameters with their errors, and the mended robots."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco

from walkerkit.gap.report import wording
from walkerkit.gap.report.console import Rows, plain
from walkerkit.gap.report.diagnosis import Estimate
from walkerkit.gap.report.gaps import Gap
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.replayed import gap_of, replay_half
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit
from walkerkit.gap.simulation.mended import Mended, mended_by_name, only
from walkerkit.gap.simulation.robot import Robot

_WIDTH = 100


@dataclass(frozen=True, kw_only=True)
class FittedEffect:
    """One effect of the structure.

    Attributes:
        effect: its name in the catalogue.
        places: joints or bodies; `("*",)` where all share one value.
        parameters: its numbers.
    """

    effect: str
    places: tuple[str, ...]
    parameters: tuple[Estimate, ...]


@dataclass(frozen=True, kw_only=True, repr=False)
class Fitted:
    """Parameters of effects that were named beforehand. Printed, it is a table.

    Attributes:
        effects: the effects, in the order in which they were given.
        robots: the mended robots, one per experiment.
        problem: what was loaded.
        fit: the values as the search has them.
    """

    effects: tuple[FittedEffect, ...]
    robots: tuple[Robot, ...]
    problem: Problem
    fit: Fit

    @functools.cached_property
    def gap(self) -> Gap:
        """Root-mean-square errors of the recordings that were held out, before and after.

        They are simulated when it is first asked for.
        """
        robots = self.problem.robots, self.robots
        return gap_of(self.problem, *(replay_half(self.problem, "held", some) for some in robots))

    @property
    def mended(self) -> Mapping[str, Mended]:
        """The mended robots by the names of their models, to go on with."""
        return mended_by_name(self.robots)

    @property
    def model(self) -> mujoco.MjModel:
        """The mended model.

        Raises:
            ValueError: there are several; take one from `mended`.
        """
        return only(self.mended).model

    def value(self, effect: str, parameter: str, place: str | None = None) -> float:
        """One fitted number.

        Args:
            effect: the effect's name.
            parameter: the parameter's name.
            place: the joint or body, where there are several.

        Raises:
            KeyError: there is no such parameter, or there are several.
        """
        found = [
            estimate
            for one in self.effects
            for estimate in one.parameters
            if (one.effect, estimate.name) == (effect, parameter)
            and place in (None, estimate.place)
        ]
        if len(found) != 1:
            has = [(o.effect, e.name, e.place) for o in self.effects for e in o.parameters]
            raise KeyError(f"{(effect, parameter, place)} is {len(found)} of the parameters {has}")
        return found[0].value

    def __repr__(self) -> str:
        found = [f"{one.effect} at {', '.join(one.places)}" for one in self.effects]
        return f"<Fitted: {'; '.join(found) or 'nothing'}>"

    def __str__(self) -> str:
        size = self.gap.position
        lines = [
            f"The position error on held-out recordings is {quantity(size.before, size.unit)} "
            f"before and {quantity(size.after, size.unit)} after; the noise of the measurement "
            f"alone would leave {quantity(size.noise_floor, size.unit)}."
        ]
        table = Rows("effect", "place", "parameter", "value", "unit", right=("value",))
        notes = []
        for one in self.effects:
            for of in one.parameters:
                value, unit, warning = wording.estimate(of)
                notes += [wording.WARNINGS[warning]] if warning else []
                text = f"{value} ({warning})" if warning else value
                cells = (one.effect, wording.site(of.place), of.name, text, unit)
                table.add(*map(wording.label, cells))
        lines += ["", *plain(table, _WIDTH).splitlines()]
        lines += [f"{i}. {note}" for i, note in enumerate(dict.fromkeys(notes), start=1)]
        return "\n".join(lines)
