"""The wiring check: before any effect is looked for, is the log of this robot at all?

    experiments = rewired_experiments(robots, experiments, window=None, n_threads=0)
    named_errors(recordings)      # of them: which signs were flipped, which joints swapped

A second or so of each recording is replayed as it is. Where a joint is so far from what it should
do that its motion or its effort is not explained at all, its columns are negated and exchanged with
those of other such joints, one error at a time, and all of that is replayed in one batch. An error
is named only where it leaves a small part of a gap that was as large as the motion, or where a
joint that moves against its simulation everywhere then moves with it everywhere, however far; no
effect of the catalogue is mended by a sign.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.smooth import Smoothed
from walkerkit.gap.recordings.wiring_errors import Kind, WiringError, exchanged, rewired
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials
from walkerkit.gap.units import velocity_likeness

FloatArray = NDArray[np.float64]

_PARTS = {  # what has wires, or lines of code, of its own
    "P": ("position", "velocity"),
    "T": ("position_target", "velocity_target"),
    "F": ("effort_target", "voltage_target"),
    "E": ("effort",),
}
_LENGTH = 1.0  # s, of a stretch of a servoed robot
_BEFORE = 0.3  # s of commands before it, on their way
_MOST_STRETCHES, _MOST_TRIED_ON = 12, 3  # of a robot; of a candidate
_MOST_SPREAD, _MOSTLY = 8, 0.75  # of a recording, in which part of which an error has to show
_SIMS = 48  # at once
_MOST_SIMS = 300  # of a round
_MOST_PAIRS = 15
_MOST_ERRORS = 6
_SUSPECT = 0.5  # of the motion, that a gap has to be to be no effect's
_EXPLAINED = 0.8  # of the motion, that may be left to effects
_NO_WORSE = 1.05  # times
_BETTER = 3.0  # times, that the gap has to become smaller
_ALIKE = 0.02, 1.2  # relative gaps that cannot be told apart: difference, ratio
_WORST = 3.0  # of the motion; a simulation that ran away is no worse
_STILL = 1e-3  # rad or m; a joint that moves less says nothing
_FOLLOWS = 0.7  # correlation of a joint with the other's simulation
_AGAINST = 0.4  # correlation, opposite, of a joint of which a sign is wrong
_OPPOSITE = 0.9  # correlation of the slope of the positions with a negated velocity


@dataclass(frozen=True, kw_only=True)
class _Stretch:
    """A part of a recording with the commands before it.

    Attributes:
        source: index of its recording.
        recording: the part.
        first: its first sample that is compared.
    """

    source: int
    recording: Recording
    first: int

    def changed(self, kind: Kind, columns: Sequence[str]) -> _Stretch:
        return replace(self, recording=exchanged(self.recording, kind, columns))

    @property
    def segment(self) -> Segment:
        return Segment(recording=self.recording, first=self.first, last=len(self.recording.time))


@dataclass(frozen=True, kw_only=True)
class _Replayed:
    """What the joints of a stretch did and should have done.

    Attributes:
        measured, predicted: (rows, joints, 2) positions and efforts, NaN where not measured.
    """

    measured: FloatArray
    predicted: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    kind: Kind
    joints: tuple[str, ...]
    columns: tuple[str, ...]
    parts: str  # of _PARTS


@dataclass(frozen=True)
class _Found:
    """An error that explains some of what is off.

    Attributes:
        gained: by how much less is off, squared.
        left: (joints, 2) of its joints, what of their motion is off once it is mended.
        candidate: the error.
        before, after: the stretches that it was tried on, without and with it mended.
    """

    gained: float
    left: FloatArray
    candidate: _Candidate
    before: Sequence[_Replayed]
    after: Sequence[_Replayed]

    def explains_as_much_as(self, best: _Found) -> bool:
        """Whether it leaves as little; what is off by all of its motion, nothing explains."""
        own, others = (np.minimum(one.left, 1.0) for one in (self, best))
        return bool(np.nanmax(own - _ALIKE[1] * others) <= _ALIKE[0])


def rewired_experiments(
    robots: Sequence[Robot],
    experiments: Sequence[Experiment],
    *,
    window: float | None,
    n_threads: int,
) -> tuple[Experiment, ...]:
    """The experiments with errors of wiring mended; each is remembered by its recordings.

    Args:
        robots: one per experiment.
        experiments: what was recorded.
        window: seconds after which replays restart, or None for whole rollouts.
        n_threads: threads of the simulation, 0 for all cores.
    """
    return tuple(
        replace(
            experiment,
            recordings=_Check(robot, experiment.recordings, window, n_threads).mended(),
        )
        for robot, experiment in zip(robots, experiments, strict=True)
    )


class _Check:
    """The check of one robot's recordings."""

    def __init__(
        self,
        robot: Robot,
        recordings: Sequence[Recording],
        window: float | None,
        n_threads: int,
    ):
        self._robot = robot
        self._recordings = [_with_velocity(recording, robot) for recording in recordings]
        self._threads = n_threads
        self._windowed = window is not None
        self._length = _LENGTH if window is None else window
        self._joints = tuple(dict.fromkeys(j for r in recordings for j in r.joints))

    def mended(self) -> tuple[Recording, ...]:
        stretches = self._stretches()
        for _ in range(_MOST_ERRORS if stretches else 0):
            replayed = self._replay(stretches)
            error, which = self._worst(stretches, replayed)
            if error is None:
                break
            stretches = [
                s.changed(error.kind, error.columns) if s.source in which else s for s in stretches
            ]
            for source in which:
                self._recordings[source] = rewired(self._recordings[source], error)
        return tuple(self._recordings)

    def _stretches(self) -> list[_Stretch]:
        """Where each joint moves most, in each recording."""
        most = max(1, _MOST_STRETCHES // len(self._recordings))
        return [
            stretch
            for number, recording in enumerate(self._recordings)
            for stretch in _liveliest(number, recording, self._length, most)
        ]

    def _replay(self, stretches: Sequence[_Stretch]) -> list[_Replayed]:
        """Simulates stretches, many at once."""
        channels = [
            Channel(joint=j, signal=s) for j in self._joints for s in ("position", "effort")
        ]
        found = []
        for start in range(0, len(stretches), _SIMS):
            some = stretches[start : start + _SIMS]
            replay = Replay(
                self._robot, [s.segment for s in some], channels, n_threads=self._threads
            )
            predicted = replay.predict(Trials(self._robot, 1))[0]
            for number in range(len(some)):
                rows = replay.segment_of_row == number
                shape = int(rows.sum()), len(self._joints), 2
                found.append(
                    _Replayed(
                        measured=replay.measured[rows].reshape(shape),
                        predicted=predicted[rows].reshape(shape),
                    )
                )
        return found

    def _worst(
        self, stretches: Sequence[_Stretch], replayed: Sequence[_Replayed]
    ) -> tuple[WiringError | None, frozenset[int]]:
        """The error that explains most, and the recordings that have it; None where none does."""
        sources = np.array([stretch.source for stretch in stretches])
        # (stretches, joints): what is as far off as no effect makes it, in position or in effort.
        alone = np.nan_to_num(np.stack([_relative([one]) for one in replayed])).max(axis=2)
        suspect = alone > _SUSPECT
        found = self._explaining(stretches, replayed, alone, suspect)
        for best in sorted(found, key=lambda one: one.gained, reverse=True):
            places = self._places(best.candidate)
            which = self._affected(suspect[:, places].all(axis=1), alone[:, places], sources)
            if self._explains_all(best.candidate, which):
                break
        else:
            return None, frozenset()
        rivals = [
            one
            for one in found
            if one.candidate.joints == best.candidate.joints and one.explains_as_much_as(best)
        ]
        # Of errors that explain as much, the one with the fewest wires.
        rivals.sort(
            key=lambda one: (
                len(one.candidate.parts),
                [*_PARTS].index(one.candidate.parts[0]),
            )
        )
        return self._told(rivals, which), which

    def _places(self, candidate: _Candidate) -> list[int]:
        """Where its joints are among all."""
        return [self._joints.index(joint) for joint in candidate.joints]

    def _explaining(
        self,
        stretches: Sequence[_Stretch],
        replayed: Sequence[_Replayed],
        alone: FloatArray,
        suspect: NDArray[np.bool_],
    ) -> list[_Found]:
        """The errors that explain some of what is too far off to be an effect.

        Args:
            stretches: what was replayed.
            replayed: that.
            alone: (stretches, joints) how far off each is.
            suspect: which of them are too far off.
        """
        suspects = [self._joints[k] for k in np.flatnonzero(suspect.any(axis=0))]
        trials = []
        sims = 0
        for candidate in self._candidates(suspects, stretches, replayed):
            places = self._places(candidate)
            off = np.where(suspect[:, places].all(axis=1), alone[:, places].min(axis=1), 0.0)
            tried = [int(k) for k in np.argsort(-off)[:_MOST_TRIED_ON] if off[k] > 0]
            if tried and sims + len(tried) <= _MOST_SIMS:
                sims += len(tried)
                trials.append((candidate, places, tried))
        if not trials:
            return []
        results = iter(
            self._replay(
                [stretches[k].changed(c.kind, c.columns) for c, _, tried in trials for k in tried]
            )
        )
        found = []
        for candidate, places, tried in trials:
            before = [replayed[k] for k in tried]
            after = list(itertools.islice(results, len(tried)))
            old, new = _relative(before), _relative(after)
            # What it does to the others counts too: they hang on the same links.
            gained = float(np.nansum(old**2) - np.nansum(new**2))
            if gained > 0 and (
                _explains(old[places], new[places])
                or (candidate.kind == "sign_flip" and _turns(before, after, places[0]))
            ):
                found.append(_Found(gained, new[places], candidate, before, after))
        return found

    def _told(self, rivals: Sequence[_Found], which: frozenset[int]) -> WiringError:
        """The first of errors that explain as much, and the second as what else it may be."""
        named, before, after = rivals[0].candidate, rivals[0].before, rivals[0].after
        places = self._places(named)
        sizes = [[_gap(some, places, signal) for some in (before, after)] for signal in (0, 1)]
        # Told in position, unless it is the effort that vanishes.
        signal = 0 if sizes[0][0] > _BETTER * sizes[0][1] or named.parts == "P" else 1
        signal = signal if np.isfinite(sizes[signal]).all() else 0
        slide = self._robot.joints[named.joints[0]].slide
        channel = Channel(joint=named.joints[0], signal=("position", "effort")[signal])
        return WiringError(
            kind=named.kind,
            joints=named.joints,
            columns=named.columns,
            gap_before=sizes[signal][0],
            gap_after=sizes[signal][1],
            unit=channel.unit(slide=slide),
            recordings=tuple(self._recordings[k].name for k in sorted(which)),
            or_else=rivals[1].candidate.columns if len(rivals) > 1 else (),
        )

    def _explains_all(self, candidate: _Candidate, which: frozenset[int]) -> bool:
        """Whether an error leaves less all over recordings, not only where they are furthest off.

        Of many stretches of a robot that is hard to predict one is always far off, and some
        exchange comes near it by chance.
        """
        some = [
            stretch
            for source in which
            for stretch in _spread(source, self._recordings[source], self._length, _MOST_SPREAD)
        ]
        changed = [one.changed(candidate.kind, candidate.columns) for one in some]
        left = [np.nansum(_relative([one]) ** 2) for one in self._replay([*some, *changed])]
        old, new = np.array(left).reshape(2, len(some))
        told = old != new  # something moves
        return bool(np.sum(new < old) > _MOSTLY * told.sum())

    def _affected(
        self, wrong: NDArray[np.bool_], alone: FloatArray, sources: NDArray[np.int64]
    ) -> frozenset[int]:
        """Recordings that have an error: where it shows, or all if it is absent in none."""
        shown = {int(source) for source in sources[wrong]}
        moved = (alone > 0).all(axis=1)
        clean = {int(source) for source in sources[moved & ~wrong]} - shown
        return frozenset(shown if clean else range(len(self._recordings)))

    def _candidates(
        self,
        suspects: Sequence[str],
        stretches: Sequence[_Stretch],
        replayed: Sequence[_Replayed],
    ) -> Iterator[_Candidate]:
        for joint in suspects:
            place = self._joints.index(joint)
            follows = min(_correlation(one, place) for one in replayed) > _FOLLOWS
            yield from (one for one in self._flips(joint) if not (follows and _is_odd(one)))
        for number, pair in enumerate(itertools.combinations(suspects, 2)):
            swapped = _each_other(self._commanded(pair, stretches)) or _each_other(
                self._efforts(pair, replayed)
            )
            for parts in ("P", "T", "F", "TF", "PE", "E", "PTFE"):
                # Exchanged altogether, they follow their own targets.
                if swapped or (number < _MOST_PAIRS and (parts == "PTFE" or self._windowed)):
                    columns = self._pair(*pair, parts)
                    if columns:
                        yield _Candidate(
                            kind="joint_swap", joints=pair, columns=columns, parts=parts
                        )

    def _flips(self, joint: str) -> Iterator[_Candidate]:
        columns = {part: self._columns(joint, part) for part in _PARTS}
        there = [part for part in _PARTS if columns[part]]
        for count in range(1, len(there) + 1):
            for some in itertools.combinations(there, count):
                yield _Candidate(
                    kind="sign_flip",
                    joints=(joint,),
                    columns=tuple(itertools.chain(*(columns[part] for part in some))),
                    parts="".join(some),
                )

    def _pair(self, first: str, second: str, parts: str) -> tuple[str, ...]:
        """The columns of both joints, none where they have not the same."""
        columns: list[str] = []
        for part in parts:
            mine, others = (self._columns(joint, part) for joint in (first, second))
            if not mine and not others and len(parts) == len(_PARTS):
                continue
            if not mine or [n.rpartition("/")[2] for n in mine] != [
                n.rpartition("/")[2] for n in others
            ]:
                return ()
            columns += [*mine, *others]
        return tuple(columns)

    def _columns(self, joint: str, part: str) -> list[str]:
        names = [f"{joint}/{signal}" for signal in _PARTS[part]]
        return [n for n in names if any(n in r.columns for r in self._recordings)]

    def _commanded(
        self, pair: tuple[str, str], stretches: Sequence[_Stretch]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Positions of two joints and their targets, (rows, 2) of each stretch; none without."""
        found = []
        for stretch in stretches:
            columns = stretch.recording.columns
            names = [[f"{j}/{signal}" for j in pair] for signal in ("position", "position_target")]
            if all(name in columns for both in names for name in both):
                done, wanted = (np.stack([columns[n] for n in both], axis=1) for both in names)
                found.append((done, wanted))
        return found

    def _efforts(
        self, pair: tuple[str, str], replayed: Sequence[_Replayed]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Measured and simulated efforts of two joints, (rows, 2) of each stretch."""
        places = [self._joints.index(joint) for joint in pair]
        found = [(one.measured[:, places, 1], one.predicted[:, places, 1]) for one in replayed]
        return [both for both in found if all(np.isfinite(values).all() for values in both)]


def _is_odd(flip: _Candidate) -> bool:
    """Whether a flip turns either what a joint does or what it should do, and not both."""
    return ("P" in flip.parts) != any(part in flip.parts for part in "TF")


def _each_other(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> bool:
    """Whether each of two joints did what the other should have done, and not what it should."""
    if not pairs:
        return False
    done, wanted = (
        np.concatenate([values - values.mean(axis=0) for values in column])
        for column in zip(*pairs, strict=True)
    )
    scale = np.linalg.norm(done, axis=0)[:, None] * np.linalg.norm(wanted, axis=0)
    if not scale.all():
        return False
    alike = done.T @ wanted / scale
    crossed = min(alike[0, 1], alike[1, 0])
    return bool(crossed > _FOLLOWS and crossed > max(alike[0, 0], alike[1, 1]))


def _explains(old: FloatArray, new: FloatArray) -> bool:
    """Whether a gap as large as the motion all but vanishes, in one signal, at no cost elsewhere.

    Args:
        old: (joints, 2) relative gaps of positions and of efforts, NaN where there is none.
        new: the same with the error mended.
    """
    before, after = (
        np.sqrt(np.nanmean(np.where(np.isnan(gap).all(axis=0), 0.0, gap) ** 2, axis=0))
        for gap in (old, new)
    )
    vanished = (before > _SUSPECT) & (after < _EXPLAINED) & (_BETTER * after < before)
    return bool(vanished.any() and (after <= _NO_WORSE * before + _ALIKE[0]).all())


def _turns(before: Sequence[_Replayed], after: Sequence[_Replayed], place: int) -> bool:
    """Whether a joint moves against its simulation in every stretch, and with it once mended."""
    if len(before) < _MOST_TRIED_ON:
        return False
    against, along = ([_correlation(one, place) for one in some] for some in (before, after))
    return max(against) < -_AGAINST and min(along) > _FOLLOWS


def _correlation(one: _Replayed, place: int) -> float:
    """Correlation of a joint's position with its simulation; 0 where either stands or ran away."""
    done, wanted = (
        some[:, place, 0] - some[:, place, 0].mean() for some in (one.measured, one.predicted)
    )
    scale = float(np.linalg.norm(done) * np.linalg.norm(wanted))
    return float(done @ wanted) / scale if np.isfinite(scale) and scale > 0 else 0.0


def _relative(replayed: Sequence[_Replayed]) -> FloatArray:
    """(joints, 2) gaps of positions and efforts over their motion; NaN where nothing moved."""
    wrong = np.zeros(replayed[0].measured.shape[1:])
    motion, rows = np.zeros_like(wrong), 0
    for one in replayed:
        gap = one.predicted - one.measured
        # A zero that is off is an effect, and moves the whole stretch.
        gap[..., 0] -= np.mean(gap[..., 0], axis=0)
        wrong += np.sum(gap**2, axis=0)
        motion += np.sum((one.measured - np.mean(one.measured, axis=0)) ** 2, axis=0)
        rows += len(gap)
    moved = motion > rows * np.array([_STILL**2, 0.0])
    moved &= moved[:, :1]  # the effort of a joint that is held says little of its wiring
    ratio = np.sqrt(wrong / np.where(moved, motion, 1.0))
    ratio = np.where(np.isnan(wrong), _WORST, np.minimum(ratio, _WORST))  # NaN: it ran away
    relative: FloatArray = np.where(moved, ratio, np.nan)
    return relative


def _gap(replayed: Sequence[_Replayed], places: Sequence[int], signal: int) -> float:
    """Root-mean-square gap of some joints, in their unit."""
    gap = np.concatenate([(o.predicted - o.measured)[:, places, signal] for o in replayed])
    return float(np.sqrt(np.nanmean(gap**2))) if np.isfinite(gap).any() else float("inf")


def _liveliest(source: int, recording: Recording, length: float, most: int) -> Iterator[_Stretch]:
    """Stretches of a recording in which each of its joints moves most."""
    spans = _spans(recording, length)
    if not spans:
        return
    motion = np.array(
        [
            [np.std(recording.columns[f"{joint}/position"][a:b]) for joint in recording.joints]
            for a, b in spans
        ]
    )
    motion = motion / np.maximum(motion.max(axis=0), 1e-12)
    chosen: list[int] = []
    covered = np.zeros(motion.shape[1])
    while len(chosen) < most:
        gain = np.maximum(motion - covered, 0.0).sum(axis=1)
        best = int(np.argmax(gain))
        if gain[best] <= 0.1:
            break
        chosen.append(best)
        covered = np.maximum(covered, motion[best])
    for k in chosen or [0]:
        yield _stretch(source, recording, *spans[k])


def _spread(source: int, recording: Recording, length: float, most: int) -> Iterator[_Stretch]:
    """Stretches all over a recording."""
    spans = _spans(recording, length)
    for k in np.unique(np.linspace(0, len(spans) - 1, min(most, len(spans))).astype(int)):
        yield _stretch(source, recording, *spans[k])


def _spans(recording: Recording, length: float) -> list[tuple[int, int]]:
    """First and last row, exclusive, of stretches of a length that no break divides."""
    time = recording.time
    length = min(length, float(time[-1] - time[0]))
    count = max(1, int((time[-1] - time[0]) / length))
    edges = np.searchsorted(time, time[0] + length * np.arange(count + 1))
    edges[-1] = len(time) if count == 1 else edges[-1]
    anew = recording.starts_anew
    return [
        (int(a), int(b))
        for a, b in itertools.pairwise(edges)
        if b - a >= 8 and not anew[max(a - 1, 0) : b - 1].any()
    ]


def _stretch(source: int, recording: Recording, first: int, last: int) -> _Stretch:
    start = int(np.searchsorted(recording.time, recording.time[first] - _BEFORE))
    return _Stretch(
        source=source,
        recording=replace(
            recording,
            time=recording.time[start:last],
            columns={name: v[start:last] for name, v in recording.columns.items()},
            part_of=None,
        ),
        first=first - start,
    )


def _with_velocity(recording: Recording, robot: Robot) -> Recording:
    """The recording with flipped signs of velocities mended, which need no simulation to show."""
    for joint in recording.joints:
        likeness = velocity_likeness(recording, joint)
        if likeness is None or likeness.alike > -_OPPOSITE:
            continue
        velocity, position = (recording.columns[f"{joint}/{s}"] for s in ("velocity", "position"))
        slope = Smoothed(recording.time, position[None]).slope_at(recording.time)[:, 0]
        before, after = (
            float(np.sqrt(np.mean((sign * velocity - slope) ** 2))) for sign in (1, -1)
        )
        error = WiringError(
            kind="sign_flip",
            joints=(joint,),
            columns=(f"{joint}/velocity",),
            gap_before=before,
            gap_after=after,
            unit=Channel(joint=joint, signal="velocity").unit(slide=robot.joints[joint].slide),
            recordings=(recording.name,),
        )
        recording = rewired(recording, error)
    return recording
