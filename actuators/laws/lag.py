"""A delay line in whole physics steps, whose lag may wander.

`lag` steps after a target was pushed it comes out, whatever was pushed in between. The first target
after a reset stands for all that came before it, so that a robot at rest is not asked for zeros.
Each simulation has a lag of its own, which is drawn within its bounds at the reset, and again every
`update_period` steps but with probability `hold_prob`. Several lines may have their lags in common:
what is sent in one packet arrives together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
_AHEAD = 64  # redraws that each simulation with a source of its own draws at a time
Random: TypeAlias = "np.random.Generator | np.random.RandomState"  # numpy.random loads late


@dataclass(frozen=True, kw_only=True)
class LagSchedule:
    """How the lag of a delay line is drawn.

    Attributes:
        min_lag: least lag [steps].
        max_lag: greatest lag [steps].
        hold_prob: probability that a redraw keeps the lag as it is.
        update_period: steps between redraws; 0 stands for every step.
        phase: each simulation redraws at steps of its own, drawn within the period at the reset.
    """

    min_lag: int
    max_lag: int
    hold_prob: float = 0.0
    update_period: int = 0
    phase: bool = False

    @property
    def constant(self) -> bool:
        """There is one lag only."""
        return self.min_lag == self.max_lag

    @property
    def wanders(self) -> bool:
        """The lag may change within an episode."""
        return not self.constant and self.hold_prob < 1


class Lags:
    """The lag of each simulation, which may wander.

    Args:
        schedule: how lags are drawn.
        batch_shape: () or (n_sims,).
        seed: of the lags.

    Attributes:
        now: the present lags [steps], () or (n_sims,).
        same: the one lag of all simulations, where there is one; else None.
        wanders: they may change within an episode.
    """

    def __init__(
        self, schedule: LagSchedule, batch_shape: tuple[int, ...], seed: np.random.SeedSequence
    ):
        self._schedule = schedule
        self.wanders = schedule.wanders
        self._period = max(schedule.update_period, 1)
        self._batch_shape = batch_shape
        # One source for resets and one for redraws, which takes numbers for all simulations at
        # once: a partial reset then leaves the lags of the others as they would have been.
        resets, redraws = seed.spawn(2)
        self._resets = np.random.default_rng(resets)
        self._redraws = np.random.default_rng(redraws)
        self._low: IntArray = np.full(batch_shape, schedule.min_lag, dtype=np.intp)
        self._high: IntArray = np.full(batch_shape, schedule.max_lag, dtype=np.intp)
        self.now: IntArray = np.zeros(batch_shape, dtype=np.intp)
        self.same: int | None = None
        self._age: IntArray = np.zeros(batch_shape, dtype=np.intp)
        self._phase: IntArray = np.zeros(batch_shape, dtype=np.intp)
        self._sources: _Sources | None = None
        self.reset(None)

    @property
    def bounds(self) -> tuple[IntArray, IntArray]:
        """Least and greatest lag [steps], () or (n_sims,) each."""
        return self._low.copy(), self._high.copy()

    def narrow(self, low: IntArray, high: IntArray, rows: IntArray | None) -> None:
        """Sets other bounds, within the schedule's; lags follow at the next reset.

        Args:
            low: least lag [steps], () or (n_rows,).
            high: greatest lag [steps].
            rows: simulations; None for all.
        """
        at = ... if rows is None else rows
        self._low[at] = np.clip(low, 0, self._schedule.max_lag)
        self._high[at] = np.clip(high, self._low[at], self._schedule.max_lag)

    def set(self, lags: IntArray, rows: IntArray | None) -> None:
        """Sets the present lags, until they are drawn again.

        Args:
            lags: within the schedule's greatest [steps], a number or (n_rows,).
            rows: simulations; None for all.
        """
        self.now[... if rows is None else rows] = lags
        self._settle()

    def reset(self, rows: IntArray | None, random_state: Random | None = None) -> None:
        """Draws the lags, of all simulations or of some rows.

        Args:
            rows: simulations; None for all.
            random_state: where lags come from; with all simulations also those of the redraws to
                come, so that the same source gives the same episode.
        """
        at = ... if rows is None else rows
        source = self._resets if random_state is None else random_state
        self.now[at] = self._draw(source)[at]
        if self._schedule.phase:
            share = source.uniform(size=self._batch_shape)
            self._phase[at] = np.floor(share * self._period).astype(np.intp)[at]
        if rows is None and random_state is not None and self.wanders:
            seed = np.frombuffer(random_state.bytes(16), dtype=np.uint32)
            self._redraws = np.random.default_rng(seed)
        self._age[at] = 0
        self._settle()

    def adopt(self, row: int, lags: Lags) -> None:
        """Lets one simulation go on as that of one physics, which has just been reset.

        Args:
            row: the simulation, which has been reset as well.
            lags: of the same schedule; their source of redraws is this simulation's from now on.
        """
        self.now[row], self._phase[row] = lags.now, lags._phase
        if self.wanders:
            if self._sources is None:
                self._sources = _Sources(len(self.now))
            self._sources.adopt(row, lags._redraws)
        self._settle()

    def step(self) -> None:
        """Goes on by a step, in which lags may be drawn again."""
        # The lag that the reset drew lasts for the first period.
        due = (self._age > 0) & ((self._age + self._phase) % self._period == 0)
        self._age += 1
        if not self._batch_shape and not due:
            return
        if self._sources is not None:
            share, luck = self._sources.draw(due)
            drawn = self._within(share)
        else:
            drawn = self._draw(self._redraws)
            luck = self._redraws.uniform(size=self._batch_shape)
        keep = luck < self._schedule.hold_prob
        self.now[...] = np.where(due & ~keep, drawn, self.now)
        self._settle()

    def _draw(self, random_state: Random) -> IntArray:
        return self._within(random_state.uniform(size=self._batch_shape))

    def _within(self, share: FloatArray | float) -> IntArray:
        """Lags at these shares of the way from the least to the greatest."""
        drawn = self._low + np.floor(share * (self._high - self._low + 1)).astype(np.intp)
        return np.asarray(np.minimum(drawn, self._high))

    def _settle(self) -> None:
        """Remembers the one lag of all simulations, where there is one: the common, fast case."""
        lags = self.now.ravel()
        same = bool((lags == lags[0]).all()) if lags.size else True
        self.same = (int(lags[0]) if lags.size else 0) if same else None


class DelayLine:
    """Delays targets of shape (n_joints,) or (n_sims, n_joints).

    Args:
        schedule: how lags are drawn.
        shape: of the targets.
        seed: of the lags.
        lags: those of several lines, who steps and resets them; None for lags of its own.

    Attributes:
        lags: its lags, or those that it shares.
    """

    def __init__(
        self,
        schedule: LagSchedule,
        shape: tuple[int, ...],
        seed: np.random.SeedSequence,
        lags: Lags | None = None,
    ):
        batch_shape = shape[:-1]
        self.lags = Lags(schedule, batch_shape, seed) if lags is None else lags
        self._own = lags is None
        self._steps = self._own and schedule.wanders
        self._size = schedule.max_lag + 1
        self._ring = np.zeros((self._size, *shape))
        self._fresh: NDArray[np.bool_] = np.ones(batch_shape, dtype=bool)
        self._any_fresh = True
        self._head = 0
        self._last: FloatArray | None = None
        self._times = 0
        self._settled: FloatArray = self._ring[0]

    @property
    def lag(self) -> IntArray:
        """The present lag [steps], () or (n_sims,), a copy."""
        return self.lags.now.copy()

    @property
    def settled(self) -> bool:
        """Nothing else comes out until something else is pushed, or the line is reset."""
        return self._last is not None and self._times == self._size and not self.lags.wanders

    @property
    def bounds(self) -> tuple[IntArray, IntArray]:
        """Least and greatest lag [steps], () or (n_sims,) each."""
        return self.lags.bounds

    def narrow(self, low: IntArray, high: IntArray, rows: IntArray | None) -> None:
        """As `Lags.narrow`."""
        self.lags.narrow(low, high, rows)

    def reset(self, rows: IntArray | None, random_state: Random | None = None) -> None:
        """Forgets the past of all simulations or of some rows, and draws lags of its own.

        Args:
            rows: as in `Lags.reset`.
            random_state: as in `Lags.reset`.
        """
        if self._own:
            self.lags.reset(rows, random_state)
        self._fresh[... if rows is None else rows] = True
        self._any_fresh = True
        self._last = None

    def adopt(self, row: int, line: DelayLine) -> None:
        """As `Lags.adopt`."""
        self.lags.adopt(row, line.lags)

    def push(self, target: FloatArray) -> FloatArray:
        """Takes the present target and gives the delayed one, a view of the line.

        The same object comes out as long as a target that nobody can write to has filled the line.
        """
        if self._steps:
            self.lags.step()
        if target is self._last:
            if self._times == self._size:
                return self._settled
            self._times += 1
        else:
            self._last = None if target.flags.writeable else target
            self._times = 1
        self._head = head = (self._head + 1) % self._size
        self._ring[head] = target
        if self._any_fresh:
            self._ring[:, self._fresh] = target[self._fresh]
            self._fresh[...] = False
            self._any_fresh = False
        if self._times == self._size:
            self._settled = self._ring[head]
        same = self.lags.same
        if same is not None:
            return self._ring[head - same]  # type: ignore[no-any-return]
        lags = self.lags.now
        return self._ring[head - lags, np.arange(len(lags))]


class _Sources:
    """A source of redraws for each simulation, which yields what a line of its own would draw."""

    def __init__(self, n_sims: int):
        self._generators = np.random.default_rng(0).spawn(n_sims)
        self._drawn: FloatArray = np.zeros((n_sims, _AHEAD, 2))
        self._next: IntArray = np.full(n_sims, _AHEAD, dtype=np.intp)

    def adopt(self, row: int, generator: np.random.Generator) -> None:
        """Replaces the source of one simulation."""
        self._generators[row] = generator
        self._next[row] = _AHEAD

    def draw(self, due: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Two numbers each, (n_sims,); they are used up where one is due."""
        for row in np.flatnonzero(due & (self._next == _AHEAD)):
            self._drawn[row] = self._generators[row].uniform(size=(_AHEAD, 2))
            self._next[row] = 0
        pairs = self._drawn[np.arange(len(due)), np.minimum(self._next, _AHEAD - 1)]
        self._next[due] += 1
        return pairs[:, 0], pairs[:, 1]
