"""How well a structure explains the recordings: residuals, and one score.

The score is the mean over the measured channels of ½ log(mean square gap + floor²): the log of the
geometric mean of their gaps. It is the profile likelihood of channels whose error variance is
unknown, so neither units nor an optimistic noise estimate decide what counts; 0.05 less means
gaps that are five per cent smaller.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.decision import NUMERICAL_LEFT
from walkerkit.gap.search.effort import spend
from walkerkit.gap.search.known_error import KnownError
from walkerkit.gap.search.numerical_error import NumericalError, Way
from walkerkit.gap.search.recent import Recent
from walkerkit.gap.search.starting_states import ALIKE, Starts, start_errors
from walkerkit.gap.search.structure import Case, Fit, Structure
from walkerkit.gap.simulation.branches import branches
from walkerkit.gap.simulation.replay import Channel, Replay, predict_together
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Segments = tuple[tuple[int, ...], ...]  # of each replay
_Float = TypeVar("_Float", np.float32, np.float64)

_MEMORY = 2**28  # bytes of residuals held at once, unless one case alone takes more
_REMEMBERED = 4  # values at which the numerical error is known
_EVERY = 8  # segments, of which one is simulated to see whether that is still as it was
_NO_MATTER = 0.03  # of a gap, which another numerical error may change
_COARSE = 6  # times the floor; changes by more, of a finer timestep, a still finer one tells better
_LEAST_FLOOR = 1e-9  # of logs without any noise
_PASSES = 3  # of freeing a gap of errors of its starts, and finding what is left of it
_SAMPLES_OF_PRIOR = 10  # for each that is independent
BLOCK = 0.5  # s; longer than the memory of a joint's error
_FOLDS = 10  # of cross-validation


@dataclass(frozen=True, kw_only=True)
class Moves:
    """Rows of a case that each move several numbers at once, which show in different channels.

    Attributes:
        row: (n_moves,) index of the row in which each is moved.
        shown: (n_moves, n_scored) bool, the channels in which each can show.
    """

    row: NDArray[np.intp]
    shown: NDArray[np.bool_]

    def apart(self, changes: NDArray[_Float]) -> NDArray[_Float]:
        """(n_rows, rows, n_scored) changes → (n_moves, rows, n_scored); NaN for what diverged."""
        moved = changes[self.row]
        if not self.shown.all():
            moved *= self.shown[:, None, :]
        return moved


class Objective:
    """Recordings of one or several robots, compared with what structures predict.

    Args:
        replays: one per robot, over the same channels.
        scored: channels that count; the others are only simulated.
        floor: (n_scored,) gap below which nothing is gained, in each channel's unit.
        n_threads: threads of the simulation, 0 for all cores.
        free_starts: segments start from a state that is only as good as its measurement; residuals
            are freed of its error, too, which `refine` finds.
        jumps: what touches down or slips a step earlier or later makes residuals jump.
        recent: where what was simulated is kept for a while, of its own by default.

    Attributes:
        numerical: the numerical error that is taken out of residuals; none until `refine` finds it.
    """

    def __init__(
        self,
        replays: Sequence[Replay],
        scored: Sequence[Channel],
        floor: FloatArray,
        *,
        n_threads: int = 1,
        free_starts: bool = False,
        jumps: bool = False,
        recent: Recent | None = None,
    ):
        self.replays = tuple(replays)
        self.recent = Recent() if recent is None else recent
        self._owner = object()  # of what is kept there, also by those that are `apart`
        self.n_threads = n_threads
        self._free_starts = free_starts
        self.jumps = jumps
        self.channels = tuple(scored)
        self.floor = np.maximum(floor, _LEAST_FLOOR)
        self._columns = [replays[0].channels.index(channel) for channel in scored]
        self.measured = np.concatenate([r.measured[:, self._columns] for r in replays])
        self.numerical = NumericalError.none(self.measured.shape)
        # A channel that only other recordings have counts, but nothing can change its score.
        self.count = np.maximum(np.isfinite(self.measured).sum(axis=0), 1)
        self._refined: deque[KnownError] = deque(maxlen=_REMEMBERED)
        self._finer: Mapping[Way, Objective] = {}
        self.root: FloatArray | None = None  # (rows, n_scored) of how much each counts
        self._coarse = False
        self._some: dict[Segments, tuple[Objective, BoolArray]] = {}  # the latest
        self._level: tuple[NumericalError, FloatArray] | None = None

    def apart(self) -> Objective:
        """The same recordings, to have another numerical error; what is known of such is shared."""
        return copy(self)

    def trusting(self, trust: FloatArray) -> Objective:
        """The same recordings, of which some blocks count less.

        Args:
            trust: (n_blocks, n_scored) by how much the squares of each count.
        """
        other = copy(self)
        other.root = np.sqrt(trust)[self.block]
        more = other.root if self.root is None else other.root / self.root
        known = (one.times(more) for one in self._refined)
        other._refined = deque(known, maxlen=_REMEMBERED)
        other.leave_as_simulated()
        return other

    def _as_trusted(self, residual: FloatArray) -> FloatArray:
        """Residuals, (n, rows, n_scored), as much of each row as it counts."""
        return residual if self.root is None else residual * self.root

    def leave_as_simulated(self) -> None:
        """Takes no numerical error out of what will be simulated."""
        self.numerical = NumericalError.none(self.measured.shape)

    @contextmanager
    def forgetting(self) -> Iterator[None]:
        """Forgets afterwards what numerical errors were found meanwhile."""
        known = list(self._refined)
        try:
            yield
        finally:
            self._refined.clear()  # which others share
            self._refined.extend(known)

    def refine(
        self, finer: Mapping[Way, Objective], case: Case, own: FloatArray | None = None
    ) -> None:
        """As `refine`, of this objective alone, whose residual (rows, n_scored) may be known."""
        refine([(self, finer, case)], own)

    def _remembers(self, case: Case, own: FloatArray, finer: Objective) -> bool:
        """Whether the numerical error is known well enough at these values; it is that one then.

        Args:
            case: one row of values.
            own: (rows, n_scored) the residual as simulated.
            finer: the same recordings at half the timestep.
        """
        at = case.structure, case.values[0]
        near = [known for known in self._refined if known.is_near(*at, jumps=self.jumps)]
        known = near[0] if near else self._still_as(case, own, finer)
        if known is None:
            return False
        self._take(known, own)
        if not near:
            self._refined.append(replace(known, structure=case.structure, values=case.values[0]))
        return True

    def _still_as(self, case: Case, own: FloatArray, finer: Objective) -> KnownError | None:
        """The known numerical error that a few segments show to be that at other values, too."""
        others = [known for known in self._refined if known.error.ways]
        if not others or not np.isfinite(own).all():
            return None
        halves = [known.of_half for known in others]
        which = self.telling(halves, own)
        if all(len(k) == len(r.segments) for k, r in zip(which, self.replays, strict=True)):
            return None
        few, rows = finer.of_segments(which)
        there = few.simulated([case])[0][0]
        if not np.isfinite(there).all():
            return None
        change = there * (1.0 if self.root is None else self.root[rows]) - own[rows]
        # Block by block, of which few wild ones hold most of a gap, and of its numerical error.
        counts = np.maximum(few.block_counts(), 1)
        gap = few.block_squares(own[rows]) / counts + self.floor**2
        moved = [few.block_squares(change - half[rows]) / counts / gap for half in halves]
        largest = [float(one.mean(axis=0).max()) for one in moved]
        least = int(np.argmin(largest))
        return others[least] if largest[least] <= _NO_MATTER**2 else None

    def telling(self, errors: Sequence[FloatArray], own: FloatArray) -> Segments:
        """Of each replay segments that lie apart, and as many where known errors are largest.

        Where one has its error in a few, as of a motor that seldom saturates, these tell most.

        Args:
            errors: (rows, n_scored) each.
            own: (rows, n_scored) the residual beside which they are large.
        """
        gap = self.mean_square(own) + self.floor**2
        size = np.max([np.sum(one**2 / gap, axis=1) for one in errors], axis=0)
        chosen, first = [], 0
        for replay in self.replays:
            its = replay.segment_of_row
            count = len(replay.segments)
            apart = range(min(_EVERY, count) // 2, count, _EVERY)
            each = np.bincount(its, weights=size[first : first + len(its)], minlength=count)
            largest = np.argsort(-each, kind="stable")[: len(apart)]
            chosen.append(tuple(sorted({*apart, *largest.tolist()})))
            first += len(its)
        return tuple(chosen)

    def of_segments(self, which: Segments) -> tuple[Objective, BoolArray]:
        """Some segments of each replay, as simulated, and (rows,) which rows are theirs."""
        if which not in self._some:
            parts = [r.of_segments(its) for r, its in zip(self.replays, which, strict=True)]
            part = Objective(
                parts, self.channels, self.floor, n_threads=self.n_threads, jumps=self.jumps
            )
            masks = [
                np.isin(r.segment_of_row, its) for r, its in zip(self.replays, which, strict=True)
            ]
            self._some = {which: (part, np.concatenate(masks))}
        return self._some[which]

    def _started(self, case: Case) -> Case | None:
        """A row of values from starts that are off by what the measurement leaves open."""
        if not self._free_starts:
            return None
        joints = [c.joint for c in self.channels if c.signal == "position"]
        values = np.repeat(case.values, 2 * len(joints), axis=0)
        return replace(case, values=values, start_errors=start_errors(joints))

    def _learn(
        self,
        case: Case,
        own: FloatArray,
        others: Mapping[Way, FloatArray],
        started: FloatArray | None,
    ) -> None:
        """Takes the numerical error from some residuals, and that of starts.

        Args:
            case: one row of values.
            own: (rows, n_scored) as simulated.
            others: as `NumericalError.of` has them.
            started: (k, rows, n_scored) from other starts, or None.
        """
        if started is not None:
            started = started - own if np.isfinite(started).all() else None
        known = KnownError(
            structure=case.structure,
            values=case.values[0],
            error=NumericalError.of(own, others),
            started=started,
        )
        self._take(known, own)
        self._refined.append(known)

    def _take(self, known: KnownError, own: FloatArray) -> None:
        """Takes a numerical error, and what errors in starts make, out of what will be simulated.

        How much starts can make depends on what is left of the residual, (rows, n_scored).
        """
        self.numerical = known.error
        if known.started is None:
            return
        for _ in range(_PASSES):
            left = own[None].copy()
            self._take_out(self.numerical, left)
            variance = self.mean_square(left[0]) + self.floor**2
            self.numerical = known.error.beside(Starts(*self.spans, known.started, variance))

    def moves(self, only: Sequence[int | None]) -> Moves:
        """Puts moves in different branches of the robots into one row.

        Args:
            only: the only branch that each move can change, or None.
        """
        of_channel = self._branch_of_channel
        taken: dict[int | None, int] = {}
        row = np.zeros(len(only), dtype=np.intp)
        shown = np.ones((len(only), len(self.channels)), dtype=bool)
        alone = sum(branch is None for branch in only)
        for k, branch in enumerate(only):
            row[k] = taken.get(branch, 0 if branch is None else alone)
            taken[branch] = int(row[k]) + 1
            if branch is not None:
                shown[k] = [own in (None, branch) for own in of_channel]
        return Moves(row=row, shown=shown)

    @cached_property
    def _branch_of_channel(self) -> tuple[int | None, ...]:
        of_joint, _ = branches(self.replays[0].robot)
        return tuple(of_joint.get(channel.joint) for channel in self.channels)

    @cached_property
    def block(self) -> NDArray[np.int64]:
        """(rows,) index of the stretch of about half a second that a row belongs to."""
        return _blocks(self.replays)

    @cached_property
    def folds(self) -> NDArray[np.int64]:
        """(n_blocks,) index of the part of a recording, a tenth of all at most, of each block."""
        of_block = _numbered(self._recordings_of_blocks)
        folds, most = np.empty(len(of_block), dtype=np.int64), max(1, len(of_block) / _FOLDS)
        count = 0
        for recording in range(of_block.max() + 1):
            own = np.flatnonzero(of_block == recording)
            parts = -(-len(own) // most)
            folds[own] = count + np.arange(len(own)) * parts // len(own)
            count += int(parts)
        return folds

    @cached_property
    def recording_of_block(self) -> NDArray[np.int64]:
        """(n_blocks,) index of the recording of each block; pieces of one are the same."""
        return _numbered(one.whole for one in self._recordings_of_blocks)

    @property
    def _recordings_of_blocks(self) -> list[Recording]:
        """Of each block the recording, or the piece of one."""
        of_row = [r.segments[k].recording for r in self.replays for k in r.segment_of_row]
        return [of_row[row] for row in np.flatnonzero(np.diff(self.block, prepend=-1))]

    @cached_property
    def spans(self) -> tuple[list[slice], FloatArray]:
        """Rows of every segment, and how long it is [s]."""
        spans: list[slice] = []
        for one in self.replays:
            for count in np.bincount(one.segment_of_row):
                first = spans[-1].stop if spans else 0
                spans.append(slice(first, first + int(count)))
        return spans, np.array([s.duration for one in self.replays for s in one.segments])

    @property
    def steps(self) -> int:
        """Simulation steps of one evaluation."""
        return sum(replay.steps for replay in self.replays)

    def residuals(self, cases: Sequence[Case]) -> list[FloatArray]:
        """Predicted minus measured, (n, rows, n_scored) a case; 0 where nothing was measured.

        Rows of trials that diverged are NaN.
        """
        residual = self._as_simulated(cases)
        self.take_out_numerical_error(residual, cases)
        return _per_case(residual, cases)

    def in_the_light_of(self, case: Case) -> Objective:
        """The same with the numerical error at one row of values, where that is another there."""
        if not self._each_its_own:
            return self
        other = self.apart()
        other.refine(self._finer, case)
        return other

    def simulated(self, cases: Sequence[Case]) -> list[FloatArray]:
        """As `residuals`, with the numerical error in them."""
        return _per_case(self._as_simulated(cases), cases)

    def freed(self, cases: Sequence[Case]) -> list[FloatArray]:
        """As `simulated`, freed of what errors in the starting states make."""
        residual = self._as_simulated(cases)
        self.numerical.free(residual)
        return _per_case(residual, cases)

    def factor(self, way: Way, case: Case) -> float:
        """How much of what another way changes suits one row of values best; 0 where unknown."""
        residual = self.freed([case])[0]
        factors = self.numerical.take_out(residual, self.error_weights(self.mean_square(residual)))[
            0
        ]
        return float(factors[self.numerical.ways.index(way)]) if way in self.numerical.ways else 0.0

    def numerical_size(self) -> FloatArray:
        """(n_scored,) root mean square of what a finer timestep changes; 0 where unknown.

        Without what another reading of efforts changes as well, which is no error of the timestep.
        """
        numerical = self.numerical
        if not len(numerical.changes):
            return np.zeros(len(self.channels))
        half = numerical.changes[0]
        if "reading" in numerical.ways:
            read = numerical.changes[numerical.ways.index("reading")]
            square = np.einsum("rc,rc->c", read, read)
            along = np.einsum("rc,rc->c", read, half) / np.where(square > 0, square, 1.0)
            half = half - along * read
        size: FloatArray = np.sqrt(self.mean_square(half))
        return size

    @property
    def level(self) -> FloatArray:
        """(n_scored,) gap below which nothing is gained: the noise's, and the numerical error's.

        That is taken out of residuals as far as it is known, but not to the last digit.
        """
        if self._level is None or self._level[0] is not self.numerical:
            size = NUMERICAL_LEFT * self.numerical_size()
            self._level = self.numerical, np.hypot(self.floor, size)
        return self._level[1]

    def as_it_is(self, cases: Sequence[Case]) -> list[FloatArray]:
        """As `mean_squares`, with the numerical error in them."""
        return [self.mean_square(residual) for case in cases for residual in self.simulated([case])]

    def corrected(self, residual: FloatArray, changes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A residual, (rows, n_scored), and changes of it, without their numerical error."""
        at = residual[None].copy()
        self.numerical.free(at)
        self.numerical.free(changes)
        (weights,) = self.error_weights(self.mean_square(at))
        return self.numerical.take_out_along(at[0], changes, weights)

    def _as_simulated(self, cases: Sequence[Case]) -> FloatArray:
        """(n of all cases, rows, n_scored) residuals with their numerical error."""
        (residual,) = _each_simulated([(self, cases)])
        return residual

    def _less_measured(self, predicted: Sequence[FloatArray]) -> FloatArray:
        """The residuals of what each replay predicted, (n, rows, n_channels)."""
        missing = np.isnan(self.measured)
        residual = np.empty((len(predicted[0]), *self.measured.shape))
        failed = np.zeros(len(residual), dtype=bool)
        first = 0
        for one in predicted:
            rows = slice(first, first + one.shape[1])
            scored = one[:, :, self._columns]
            np.subtract(scored, self.measured[rows], out=residual[:, rows])
            if np.isnan(scored[:, :, 0]).any():
                failed |= np.any(np.all(np.isnan(scored), axis=2), axis=1)
            first = rows.stop
        residual[:, missing] = 0.0
        residual[failed] = np.nan
        return residual

    @property
    def _each_its_own(self) -> bool:
        """Whether all values have another numerical error: what jumps does so a step elsewhere."""
        return self.jumps and bool(self.numerical.ways)

    def take_out_numerical_error(self, residual: FloatArray, cases: Sequence[Case]) -> None:
        """Takes it out of the (n of all cases, rows, n_scored) residuals of some cases.

        Where residuals jump, what a finer timestep changes at one row of values says nothing of the
        next: taken out of both, the values where it was found look better than all about them.
        """
        if not self._each_its_own:
            self._take_out(self.numerical, residual)
            return
        ways, starts = self.numerical.ways, self.numerical.starts
        otherwise = _each_simulated([(self._finer[way], cases) for way in ways])
        for k, row in enumerate(residual):
            own = {way: each[k] for way, each in zip(ways, otherwise, strict=True)}
            error = NumericalError.of(row, own)
            self._take_out(error if starts is None else error.beside(starts), row[None])

    def _take_out(self, error: NumericalError, residual: FloatArray) -> None:
        error.free(residual)
        if len(error.changes):
            error.take_out(residual, self.error_weights(self.mean_square(residual)))

    def error_weights(self, mean_square: FloatArray) -> FloatArray:
        """(..., n_scored) by which channels decide on how much numerical error is taken out."""
        weights: FloatArray = 1 / (self.count * (mean_square + self.floor**2))
        return weights

    def grouped(self, cases: Sequence[Case]) -> list[slice]:
        """Consecutive cases whose residuals fit into memory together."""
        return consecutive([self.measured.nbytes * len(case.values) for case in cases], _MEMORY)

    def mean_squares(self, cases: Sequence[Case]) -> list[FloatArray]:
        """(n, n_scored) mean square gaps a case, NaN for trials that diverged."""
        return [
            self.mean_square(residual)
            for group in self.grouped(cases)
            for residual in self.residuals(cases[group])
        ]

    def best(self, case: Case, mean_square: FloatArray) -> tuple[Fit, int]:
        """The best of some values whose gaps are known, (n, n_scored), and which it is."""
        scores = self.score(mean_square) + self.penalty(case.structure, case.values)
        k = int(np.argmin(scores))
        found = Fit(
            structure=case.structure,
            values=case.values[k],
            score=float(scores[k]),
            mean_square=mean_square[k],
        )
        return found, k

    def at(self, one: Fit, residual: FloatArray) -> Fit:
        """A fit with the score that its residual has here, (rows, n_scored)."""
        found, _ = self.best(one.case, self.mean_square(residual[None]))
        return found

    def mean_square(self, residual: FloatArray) -> FloatArray:
        """(..., rows, n_scored) residuals → (..., n_scored) mean squares."""
        squares: FloatArray = np.einsum("...rc,...rc->...c", residual, residual) / self.count
        return squares

    def score(self, mean_square: FloatArray) -> FloatArray:
        """(..., n_scored) mean squares → (...) scores; infinity for a trial that diverged."""
        score = 0.5 * np.log(mean_square + self.level**2).mean(axis=-1)
        return np.where(np.isnan(score), np.inf, score)

    @cached_property
    def samples(self) -> float:
        """How many independent samples the scored channels have, if errors last `ALIKE` seconds."""
        spans, durations = self.spans
        present = [np.isfinite(self.measured[span]).any(axis=0).sum() for span in spans]
        return max(1.0, float(np.dot(present, durations)) / ALIKE)

    @property
    def prior_samples(self) -> float:
        """How many samples the priors of values are weighed against.

        More than are independent of each other where an error lasts: a prior is to decide where the
        recordings say nothing, and to draw nothing of what they know.
        """
        return _SAMPLES_OF_PRIOR * self.samples

    def penalty(self, structure: Structure, values: FloatArray) -> FloatArray:
        """(n, n_parameters) values → (n,) what their priors add to the score."""
        against: FloatArray = structure.surprise(values).sum(axis=-1)
        return against / self.prior_samples

    def weights(self, mean_square: FloatArray) -> FloatArray:
        """(n_scored,) factors that make ½ Σ w r² change as the score does near these gaps."""
        size: FloatArray = self.count * (mean_square + self.level**2) * len(self.channels)
        return 1 / size

    def block_squares(self, residual: FloatArray) -> FloatArray:
        """(rows, n_scored) residuals → (n_blocks, n_scored) sums of squares."""
        return np.stack(
            [np.bincount(self.block, weights=column**2) for column in residual.T], axis=1
        )

    def block_counts(self) -> FloatArray:
        """(n_blocks, n_scored) measured samples."""
        present = np.isfinite(self.measured).astype(float)
        return np.stack([np.bincount(self.block, weights=column) for column in present.T], axis=1)


def refine(
    wanted: Sequence[tuple[Objective, Mapping[Way, Objective], Case]], own: FloatArray | None = None
) -> None:
    """Takes the numerical error at some values as that of all that objectives will simulate.

    Args:
        wanted: each objective with the same recordings replayed in other ways, none of these with
            numerical errors of their own taken out; that at a quarter of the timestep only counts
            where half of it changes much. And one row of values.
        own: (rows, n_scored) the residual of the first as simulated, where it is known.
    """
    unknown = []
    for k, (one, finer, case) in enumerate(wanted):
        one.leave_as_simulated()
        one._finer = finer
        known = own if k == 0 else None
        if one._refined and known is None:
            known = one.simulated([case])[0][0]
        if known is None or not one._remembers(case, known, finer["half"]):
            # What was wanted the last time is asked for at once, to be done side by side.
            asked = [way for way in finer if one._coarse or way != "quarter"]
            started = one._started(case)
            simulations = [
                *([(one, [case])] if known is None else []),
                *((finer[way], [case]) for way in asked),
                *([(one, [started])] if started is not None else []),
            ]
            unknown.append((one, finer, case, known, asked, started, simulations))
    found = iter(_each_simulated([each for *_, simulations in unknown for each in simulations]))
    for one, finer, case, known, asked, started, _ in unknown:
        coarse = next(found)[0] if known is None else known
        others = {way: next(found)[0] for way in asked}
        from_others = None if started is None else next(found)
        changed = np.sqrt(one.mean_square(others["half"] - coarse))
        one._coarse = bool((changed > _COARSE * one.floor).any())
        if not one._coarse:
            others.pop("quarter", None)
        elif "quarter" in finer and "quarter" not in others:
            others["quarter"] = finer["quarter"].simulated([case])[0][0]
        one._learn(case, coarse, others, from_others)


def residuals_of(
    objectives: Sequence[Objective], cases: Sequence[Case]
) -> Iterator[list[FloatArray]]:
    """Of each case, (n, rows, n_scored) residuals for each of several objectives."""
    sizes = [sum(one.measured.nbytes for one in objectives) * len(case.values) for case in cases]
    for group in consecutive(sizes, _MEMORY):
        each = []
        simulated = _each_simulated([(one, cases[group]) for one in objectives])
        for one, residual in zip(objectives, simulated, strict=True):
            one.take_out_numerical_error(residual, cases[group])
            each.append(_per_case(residual, cases[group]))
        yield from (list(of_case) for of_case in zip(*each, strict=True))


def simulated_each(objectives: Sequence[Objective], cases: Sequence[Case]) -> Iterator[FloatArray]:
    """Of each case, (n, rows, n_scored) residuals as simulated, for an objective of its own."""
    sizes = [
        one.measured.nbytes * len(case.values) for one, case in zip(objectives, cases, strict=True)
    ]
    for group in consecutive(sizes, _MEMORY):
        # Those with the same recordings are simulated as one, of which each may trust others.
        which: dict[object, list[int]] = {}
        for k in range(len(cases))[group]:
            which.setdefault(objectives[k]._owner, []).append(k)
        simulated = _each_as_trusted_fully(
            [(objectives[mine[0]], [cases[k] for k in mine]) for mine in which.values()]
        )
        found = {
            k: objectives[k]._as_trusted(residual)
            for mine, residuals in zip(which.values(), simulated, strict=True)
            for k, residual in zip(
                mine, _per_case(residuals, [cases[k] for k in mine]), strict=True
            )
        }
        yield from (found[k] for k in sorted(found))


def consecutive(sizes: Sequence[int], most: int) -> list[slice]:
    """Groups of what follows each other, as large as they can be; what is too large is alone."""
    groups, start, together = [], 0, 0
    for i, size in enumerate(sizes):
        if together and together + size > most:
            groups.append(slice(start, i))
            start, together = i, 0
        together += size
    return [*groups, slice(start, len(sizes))] if sizes else []


def _each_simulated(wanted: Sequence[tuple[Objective, Sequence[Case]]]) -> list[FloatArray]:
    """Of each objective (n of all its cases, rows, n_scored) residuals as simulated."""
    found = _each_as_trusted_fully(wanted)
    return [one._as_trusted(each) for (one, _), each in zip(wanted, found, strict=True)]


def _each_as_trusted_fully(
    wanted: Sequence[tuple[Objective, Sequence[Case]]],
) -> list[FloatArray]:
    """As `_each_simulated`, where all rows count."""
    if not wanted:
        return []
    for one, cases in wanted:
        spend(sum(len(c.values) for c in cases) * sum(replay.steps for replay in one.replays))
    each = [one.recent.wanted(one._owner, cases) for one, cases in wanted]
    pairs = [
        (replay, mine.unknown)
        for (one, _), mine in zip(wanted, each, strict=True)
        for replay in one.replays
        if mine.unknown
    ]
    trials = [
        Trials.joined([case.trials(replay.robot) for case in cases]) for replay, cases in pairs
    ]
    n_threads = wanted[0][0].n_threads
    predicted = iter(predict_together([replay for replay, _ in pairs], trials, n_threads))
    found = []
    for (one, _), mine in zip(wanted, each, strict=True):
        new = one._less_measured([next(predicted) for _ in one.replays]) if mine.unknown else None
        found.append(mine.filled(new))
    return found


def _per_case(residual: FloatArray, cases: Sequence[Case]) -> list[FloatArray]:
    return np.split(residual, np.cumsum([len(case.values) for case in cases])[:-1])


def _numbered(recordings: Iterable[Recording]) -> NDArray[np.int64]:
    """(n,) index of each among those that are different, in their order."""
    index: dict[int, int] = {}
    return np.array([index.setdefault(id(one), len(index)) for one in recordings], dtype=np.int64)


def _blocks(replays: Sequence[Replay]) -> NDArray[np.int64]:
    labels, offset = [], 0
    for replay in replays:
        within = (replay.time_of_row / BLOCK).astype(np.int64)
        new = np.diff(within, prepend=-1) | np.diff(replay.segment_of_row, prepend=0)
        label = offset + np.cumsum(new != 0) - 1
        labels.append(label)
        offset = int(label[-1]) + 1
    return np.concatenate(labels)
