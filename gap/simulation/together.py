"""Rollouts of several robots that differ in numbers only, as one batch.

A manifest has one robot per condition: another gain, another load. Whoever steps them one by one
pays for every step of each; side by side in one batch they share it.

    rollouts = together([rollout, other])      # what `alone` returns of each, in their order
    controls = controlled([commands, others])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import joblib
import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.simulation.law_memory import Past
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.models import differing
from walkerkit.gap.simulation.start import state_offset
from walkerkit.gap.simulation.steploop import rollout_with_laws
from walkerkit.gap.simulation.trials import model_field
from walkerkit.gap.simulation.workers import side_by_side
from walkerkit.walkers.batch import LockStep, Rollout

FloatArray = NDArray[np.float64]
Done = tuple[Rollout, FloatArray | None]
Controlled = tuple[FloatArray, FloatArray | None]

_LAWS = 15  # simulations that take as long as laws do in each step
_WORTH_PROCESSES = 12_000  # steps
_FEWEST = 4  # simulations of a rollout that is shared
_UNEVEN = 1.1  # of a fair share
_LENGTH_RATIO = 0.8  # of the shortest to the longest of a batch, about
_BATCH_BYTES = 2**29  # of what is kept of all that run together


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """A rollout that is to be done: many variants of one robot.

    Attributes:
        model: the robot's.
        fields: model fields of which each simulation has its own, (n_sims, *shape).
        state: (n_sims, nstate) where they start.
        ctrl: (n_sims, n_steps, width) controls as the drives receive them.
        applied: (n_sims, n_steps, nv) effort applied beside them, or None.
        record: fields to keep after every step.
        n_threads: threads of the simulation, or processes where there are laws, 0 for all cores.
        laws: laws that are run step by step, or None.
        time: (n_sims,) of the first step, by the robot's clock [s].
        ahead, voltage: as `rollout_with_laws` takes them.
        past: what the laws saw before, or None.
        lengths: (n_sims,) the steps that count of each, or None where all do.
    """

    model: mujoco.MjModel
    fields: Mapping[str, NDArray[Any]]
    state: FloatArray
    ctrl: FloatArray
    applied: FloatArray | None
    record: tuple[str, ...]
    n_threads: int
    laws: Laws | None
    time: FloatArray
    ahead: FloatArray | None = None
    voltage: FloatArray | None = None
    past: Past | None = None
    lengths: NDArray[np.intp] | None = None

    @property
    def n_sims(self) -> int:
        """How many simulations it is."""
        return len(self.state)

    @property
    def n_steps(self) -> int:
        """How many steps it takes."""
        return int(self.ctrl.shape[1])

    @property
    def size(self) -> int:
        """Bytes of what is kept."""
        model = self.model
        row = model.nq + 2 * model.nv + model.nu
        return int(8 * self.n_sims * self.n_steps * row)

    @property
    def effort(self) -> int:
        """What doing it takes, in steps of a simulation, where there are laws."""
        return self.n_steps * (_LAWS + self.n_sims)

    def batch(self) -> LockStep:
        """Its simulations."""
        return LockStep(
            self.model,
            self.n_sims,
            fields=self.fields,
            # Threads would wait for each other in every step.
            n_threads=self.n_threads if self.laws is None else 1,
            only_rollouts=self.laws is None,
        )

    def some(self, rows: NDArray[np.intp]) -> Asked:
        """Some of the simulations."""
        return replace(
            self,
            fields={name: values[rows] for name, values in self.fields.items()},
            state=self.state[rows],
            ctrl=self.ctrl[rows],
            applied=None if self.applied is None else self.applied[rows],
            laws=None if self.laws is None else self.laws.some(rows),
            time=self.time[rows],
            ahead=None if self.ahead is None else self.ahead[rows],
            voltage=None if self.voltage is None else self.voltage[rows],
            past=None if self.past is None else self.past.some(rows),
            lengths=None if self.lengths is None else self.lengths[rows],
        )

    def done(self) -> Done:
        """What was recorded, and what the laws changed, as `rollout_with_laws` returns them."""
        if self.laws is None:
            rollout = self.batch().rollout(
                self.state,
                ctrl=self.ctrl,
                qfrc_applied=self.applied,
                record=self.record,
                lengths=self.lengths,
            )
            return rollout, None
        return rollout_with_laws(
            self.batch(),
            self.state,
            laws=self.laws,
            ctrl=self.ctrl,
            qfrc_applied=self.applied,
            record=self.record,
            time=self.time,
            ahead=self.ahead,
            voltage=self.voltage,
            past=self.past,
            lengths=self.lengths,
        )


def first_controls(asked: Asked) -> FloatArray:
    """MuJoCo's controls (n_sims, nu) in the first step, of drives in Python what they make."""
    ctrl: FloatArray = asked.ctrl[:, 0, : asked.model.nu]
    if asked.laws is None or asked.laws.programs is None:
        return ctrl
    programs = asked.laws.programs
    qpos, qvel = (
        state_offset(asked.model, component)
        for component in (mujoco.mjtState.mjSTATE_QPOS, mujoco.mjtState.mjSTATE_QVEL)
    )
    q = asked.state[:, [qpos + joint.qpos for joint in programs.joints]]
    qd = asked.state[:, [qvel + joint.dof for joint in programs.joints]]
    ctrl = ctrl.copy()
    ctrl[:, programs.motors] = programs.start(asked.model).controls(asked.ctrl[:, 0], q, qd)
    return ctrl


@dataclass(frozen=True, kw_only=True, eq=False)
class Commanded:
    """Controls of which controllers are to make others, as `Laws.controlled` takes them."""

    laws: Laws
    ctrl: FloatArray
    time: FloatArray

    @property
    def size(self) -> int:
        """Bytes of what is kept."""
        return 3 * self.ctrl.nbytes


def controlled(commanded: Sequence[Commanded]) -> list[Controlled]:
    """What `Laws.controlled` makes of each, those that can be in one batch together."""
    found: dict[int, Controlled] = {}
    for group in _grouped(
        commanded,
        lambda one, other: (
            _of_like_length(one.ctrl.shape[1], other.ctrl.shape[1]) and one.laws.joins(other.laws)
        ),
    ):
        members = [commanded[k] for k in group]
        ctrl, ahead = Laws.joined([one.laws for one in members]).controlled(
            _padded([one.ctrl for one in members]),
            np.concatenate([one.time for one in members]),
        )
        for k, rows in zip(group, _rows([len(one.ctrl) for one in members]), strict=True):
            part = rows, slice(commanded[k].ctrl.shape[1])
            found[k] = ctrl[part], None if ahead is None else ahead[part]
    return [found[k] for k in range(len(commanded))]


def together(asked: Sequence[Asked], n_threads: int) -> list[Done]:
    """Does several rollouts, those that can be in one batch, the others side by side.

    Args:
        asked: the rollouts.
        n_threads: threads or processes for all of them, 0 for all cores.

    Returns:
        What each left behind.
    """
    if not asked:
        return []
    # As many as this process may use, which is fewer than there are in many a container.
    n_threads = n_threads or joblib.cpu_count()
    groups = _grouped(asked, _alike)
    joined = [replace(_joined([asked[k] for k in some]), n_threads=n_threads) for some in groups]
    done = _all_done(joined, n_threads)
    found: dict[int, Done] = {}
    for k, group in enumerate(groups):
        found.update(zip(group, _apart(done[k], [asked[i] for i in group]), strict=True))
    return [found[k] for k in range(len(asked))]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Piece:
    """Some simulations of a rollout, which is one of several."""

    of: int
    rows: NDArray[np.intp]
    asked: Asked


def _all_done(asked: Sequence[Asked], n_processes: int) -> list[Done]:
    """What each rollout leaves behind; those with laws in several processes where that is faster.

    Laws are Python's, of which one process runs one at a time.
    """
    done = {k: one.done() for k, one in enumerate(asked) if one.laws is None}
    lawful = {k: one for k, one in enumerate(asked) if one.laws is not None}
    if n_processes == 1 or sum(one.effort for one in lawful.values()) < _WORTH_PROCESSES:
        done.update({k: one.done() for k, one in lawful.items()})
    else:
        shares = _shares(lawful, n_processes)
        each = side_by_side(_each_done, [[piece.asked for piece in share] for share in shares])
        found: dict[int, list[tuple[_Piece, Done]]] = {}
        for share, some in zip(shares, each, strict=True):
            for piece, one in zip(share, some, strict=True):
                found.setdefault(piece.of, []).append((piece, one))
        done.update({k: _whole(asked[k], pieces) for k, pieces in found.items()})
    return [done[k] for k in range(len(asked))]


def _each_done(asked: Sequence[Asked]) -> list[Done]:
    return [one.done() for one in asked]


def _shares(asked: Mapping[int, Asked], n_processes: int) -> list[list[_Piece]]:
    """Rollouts, whole or in pieces, for some processes, as even as can be."""
    shares: list[list[_Piece]] = [[] for _ in range(n_processes)]
    efforts = [0] * n_processes
    fair = _UNEVEN * sum(one.effort for one in asked.values()) / n_processes

    def give(share: int, piece: _Piece) -> None:
        shares[share].append(piece)
        efforts[share] += piece.asked.effort

    for k, one in sorted(asked.items(), key=lambda item: -item[1].effort):
        parts = min(n_processes, one.n_sims // _FEWEST)
        least = int(np.argmin(efforts))
        if one.laws is None or parts < 2 or efforts[least] + one.effort <= fair:
            give(least, _Piece(of=k, rows=np.arange(one.n_sims), asked=one))
            continue
        # What has the same laws stays together, so that each process runs few.
        order = np.lexsort(one.laws.present.T)
        for share, rows in zip(np.argsort(efforts), np.array_split(order, parts), strict=False):
            give(int(share), _Piece(of=k, rows=rows, asked=one.some(rows)))
    return [share for share in shares if share]


def _whole(asked: Asked, pieces: Sequence[tuple[_Piece, Done]]) -> Done:
    """What a rollout left behind, of what its pieces did."""
    if len(pieces) == 1:
        return pieces[0][1]
    back = np.argsort(np.concatenate([piece.rows for piece, _ in pieces]))
    rollouts, changes = zip(*(done for _, done in pieces), strict=True)
    records = {
        name: np.concatenate([one.records[name] for one in rollouts])[back] for name in asked.record
    }
    failed = np.concatenate([one.failed for one in rollouts])[back]
    changed = _or_nothing(changes, [piece.asked for piece, _ in pieces])
    return Rollout(records=records, failed=failed), None if changed is None else changed[back]


_Either = TypeVar("_Either", Asked, Commanded)


def _grouped(
    asked: Sequence[_Either], alike: Callable[[_Either, _Either], bool]
) -> list[list[int]]:
    """Indices of what can be in one batch."""
    groups: list[list[int]] = []
    for k, one in enumerate(asked):
        for group in groups:
            size = sum(asked[i].size for i in group) + one.size
            if size <= _BATCH_BYTES and alike(asked[group[0]], one):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _rows(counts: Sequence[int]) -> list[slice]:
    """Where each of some are that follow each other."""
    ends = np.cumsum(counts)
    return [slice(int(end) - n, int(end)) for end, n in zip(ends, counts, strict=True)]


def _of_like_length(one: int, other: int) -> bool:
    return _LENGTH_RATIO < one / other < 1 / _LENGTH_RATIO


def _apart(done: Done, members: Sequence[Asked]) -> list[Done]:
    rollout, changed = done
    parts = _rows([one.n_sims for one in members])
    return [
        (
            Rollout(
                records={
                    name: values[part, : one.n_steps] for name, values in rollout.records.items()
                },
                failed=rollout.failed[part],
            ),
            None if changed is None else changed[part, : one.n_steps],
        )
        for part, one in zip(parts, members, strict=True)
    ]


def _joined(members: Sequence[Asked]) -> Asked:
    first = members[0]
    if len(members) == 1:
        return first
    return replace(
        first,
        fields=_fields(members),
        state=np.concatenate([one.state for one in members]),
        ctrl=_padded([one.ctrl for one in members]),
        applied=_or_nothing([one.applied for one in members], members),
        laws=Laws.joined([one.laws for one in members if one.laws is not None])
        if first.laws is not None
        else None,
        time=np.concatenate([one.time for one in members]),
        ahead=_or_nothing([one.ahead for one in members], members),
        voltage=_or_nothing([one.voltage for one in members], members, np.nan),
        past=Past.joined([one.past for one in members if one.past is not None])
        if first.past is not None
        else None,
        lengths=np.repeat([one.n_steps for one in members], [one.n_sims for one in members]),
    )


def _or_nothing(
    parts: Sequence[FloatArray | None], members: Sequence[Asked], nothing: float = 0.0
) -> FloatArray | None:
    """Arrays (n_sims, n_steps, size) one after the other, `nothing` for those that are None."""
    size = next((part.shape[2] for part in parts if part is not None), None)
    if size is None:
        return None
    return _padded(
        [
            np.full((one.n_sims, one.n_steps, size), nothing) if part is None else part
            for part, one in zip(parts, members, strict=True)
        ]
    )


def _padded(parts: Sequence[FloatArray]) -> FloatArray:
    """Arrays (n_sims, n_steps, size) one after the other, shorter ones held as they end."""
    n_steps = max(part.shape[1] for part in parts)
    return np.concatenate(
        [np.pad(p, ((0, 0), (0, n_steps - p.shape[1]), (0, 0)), mode="edge") for p in parts]
    )


def _fields(members: Sequence[Asked]) -> dict[str, NDArray[Any]]:
    """Fields of which one has its own values, or in which the models differ."""
    names = dict.fromkeys(name for one in members for name in one.fields)
    for one in members[1:]:
        names.update(dict.fromkeys(differing(members[0].model, one.model) or ()))
    return {
        name: np.concatenate(
            [
                one.fields[name]
                if name in one.fields
                else np.repeat(model_field(one.model, name)[None], one.n_sims, axis=0)
                for one in members
            ]
        )
        for name in names
    }


def _alike(one: Asked, other: Asked) -> bool:
    """Whether two rollouts can be done in one batch."""
    return (
        _of_like_length(one.n_steps, other.n_steps)
        and one.record == other.record
        and (one.laws is None) == (other.laws is None)
        and (one.laws is None or other.laws is None or one.laws.joins(other.laws))
        and (one.past is None) == (other.past is None)
        and (one.past is None or other.past is None or one.past.joins(other.past))
        and differing(one.model, other.model) is not None  # which takes longest
    )
