"""Recordings of one role, and the parts of those that are fitted on which effects are tried.

Each is also simulated and read in other ways, which show the simulation's own numerical error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.excerpt import Gaps
from walkerkit.gap.search.numerical_error import Way
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.structure import Case, Fit
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.commands import Hold
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]
Remake = Callable[[Robot], Robot]

_REFINEMENT = 2  # how many times finer the timestep is that shows the numerical error
# Whole rollouts are searched in stretches: side by side they take less time, and tell as much.
STRETCH, _SCREEN_STRETCH = 1.5, 1.0  # s
_EXCERPT_STEPS, _SCREEN_STEPS = 12_000, 4_000
_TELLS_AS_MUCH = 0.03  # of a gap, which longer steps may change

REMADE: Mapping[Way, Remake] = {
    "half": lambda robot: robot.refined(_REFINEMENT),
    "integrator": lambda robot: robot.refined(_REFINEMENT, other_integrator=True),
    "friction": lambda robot: robot.refined(_REFINEMENT, as_dry_as_it_goes=True),
    "reading": lambda robot: replace(robot, reads_effort_first=True),
    "earlier": lambda robot: robot.reading_earlier(1.0),
    "quarter": lambda robot: robot.refined(_REFINEMENT**2),
}


def other_ways(
    robots: Sequence[Robot], channels: Sequence[Channel], hold: Hold
) -> Mapping[Way, Remake]:
    """How else some robots are simulated and read, to show the numerical error."""
    efforts = any(channel.signal == "effort" for channel in channels)
    needed: Mapping[Way, bool] = {
        "friction": any(robot.has_dry_friction for robot in robots),
        "reading": hold != "linear" and efforts,
        "earlier": efforts,
    }
    return {way: remake for way, remake in REMADE.items() if needed.get(way, True)}


@dataclass(frozen=True, kw_only=True)
class Half:
    """Recordings of one role, of all robots.

    Attributes:
        recordings: per robot.
        told: their replays over the horizon that the gap is told of.
        objective: their comparison with the simulation, in stretches.
        make_finer: makes the same in other ways, which show the numerical error.
    """

    recordings: tuple[tuple[Recording, ...], ...]
    told: tuple[Replay, ...]
    objective: Objective
    make_finer: Callable[[], Mapping[Way, Objective]]

    @cached_property
    def finer(self) -> Mapping[Way, Objective]:
        """What `make_finer` makes, where it is needed."""
        return self.make_finer()

    def trusting(self, trust: FloatArray) -> Half:
        """The same, of which some blocks count less, as `Objective.trusting` has them."""

        def finer() -> Mapping[Way, Objective]:
            return {way: one.trusting(trust) for way, one in self.finer.items()}

        return replace(self, objective=self.objective.trusting(trust), make_finer=finer)

    def by_own_error(self, fit: Fit) -> Fit:
        """A fit with the score that it has in the light of its own numerical error."""
        return self.objective.at(fit, self.residual(fit))

    def residual(self, fit: Fit) -> FloatArray:
        """(rows, n_scored) that of a fit in the light of its own numerical error."""
        self.refine(fit)
        found: FloatArray = self.objective.residuals([fit.case])[0][0]
        return found

    def refine(self, fit: Fit, residual: FloatArray | None = None) -> None:
        """Finds the simulation's numerical error at a fit, whose residual with it may be known."""
        self.objective.refine(self.finer, fit.case, residual)


class Searched:
    """The parts of what is fitted on which effects are tried, where it is long.

    Args:
        fit: what is fitted.
        part: makes a part of so many steps at most, in stretches of so many seconds, that holds its
            part of some gaps, with timesteps so many times longer; `fit` itself where it is no
            longer.
        longer: how many times the timesteps may be.

    Attributes:
        excerpt: longer parts, to which all that is ordinary is fitted before it is to the rest.
        screen: short parts, on which every effect is tried.
    """

    def __init__(
        self,
        fit: Half,
        part: Callable[[int, float, Gaps, int], Half],
        *,
        longer: int,
    ):
        self._fit, self._part, self._longer = fit, part, longer
        self._choose(Gaps(rows={}), 1)

    def look_at(self, case: Case) -> None:
        """Chooses them so that they hold their part of what one row of values leaves."""
        if self.screen is self._fit:  # and so is the excerpt, or it stays
            return
        objective = self._fit.objective
        gaps = Gaps.of(objective, objective.simulated([case])[0][0])
        self._choose(gaps, 1)
        if self._longer > 1:
            own = self.screen.objective
            self._choose(gaps, self._longer)
            if not _tells_as_much(self.screen.objective, own, case):
                self._choose(gaps, 1)

    def with_screen(self, screen: Half) -> Searched:
        """The same with another screen, which stays whatever is looked at."""
        other = copy(self)
        other._fit = other.screen = screen
        return other

    def _choose(self, gaps: Gaps, longer: int) -> None:
        self.excerpt = self._part(_EXCERPT_STEPS, STRETCH, gaps, longer)
        self.screen = self._part(_SCREEN_STEPS, _SCREEN_STRETCH, gaps, longer)


def _tells_as_much(longer: Objective, own: Objective, case: Case) -> bool:
    """Whether a gap in every channel is nearly the same with longer timesteps."""
    (residual,), (other,) = (one.simulated([case])[0] for one in (own, longer))
    gap, changed = np.sqrt(own.mean_square(np.stack([residual, other - residual])))
    return bool((changed <= _TELLS_AS_MUCH * np.maximum(gap, own.floor)).all())
