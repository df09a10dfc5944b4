"""What drivetrain laws remember where a segment starts: what was measured and commanded before.

    past = measured_past(states, starts, readings, ctrl, dt)    # for `rollout_with_laws`
    added = integral_at_start(laws, batch, state, places, logs)

An integrator remembers all the time since it was switched on. At a recording's beginning it is
taken to hold the joint where it is, as one that has settled does; from there on it adds up the
errors that were measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import IntegralAction
from walkerkit.actuators.drivetrain.drivetrain_law import clipped
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.simulation.commands import Route
from walkerkit.gap.simulation.interpolate import NEAREST
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.reading import Reading
from walkerkit.gap.simulation.robot import Joint
from walkerkit.gap.simulation.start import state_offset
from walkerkit.walkers.batch import LockStep

FloatArray = NDArray[np.float64]

_SWITCHED_ON = 10.0  # s before a recording's beginning


@dataclass(frozen=True, kw_only=True, eq=False)
class Past:
    """What was commanded and measured in the steps before the first.

    Attributes:
        ctrl: (n_sims, n_steps, nu) controls as the drives received them.
        q, qd: (n_sims, n_steps, n_joints) positions and velocities of the joints.
        unknown: (n_sims, n_steps) whether the recording had not begun.
        integral: (n_sims, n_joints) effort of integral action [N·m; N], or None where there is no
            such.
    """

    ctrl: FloatArray
    q: FloatArray
    qd: FloatArray
    unknown: NDArray[np.bool_]
    integral: FloatArray | None = None

    def joins(self, other: Past) -> bool:
        """Whether both are of as many steps, and of the same memories."""
        return (
            self.ctrl.shape[1] == other.ctrl.shape[1]
            and self.q.shape[2] == other.q.shape[2]
            and (self.integral is None) == (other.integral is None)
        )

    @classmethod
    def joined(cls, parts: Sequence[Past]) -> Past:
        """What some simulations, and then others, saw."""
        integral = [part.integral for part in parts if part.integral is not None]
        return cls(
            ctrl=np.concatenate([part.ctrl for part in parts]),
            q=np.concatenate([part.q for part in parts]),
            qd=np.concatenate([part.qd for part in parts]),
            unknown=np.concatenate([part.unknown for part in parts]),
            integral=np.concatenate(integral) if integral else None,
        )

    def some(self, rows: NDArray[np.intp]) -> Past:
        """What some of the simulations saw."""
        return Past(
            ctrl=self.ctrl[rows],
            q=self.q[rows],
            qd=self.qd[rows],
            unknown=self.unknown[rows],
            integral=None if self.integral is None else self.integral[rows],
        )


def measured_past(
    segments: Sequence[Segment],
    states: Sequence[MeasuredState],
    shift: FloatArray,
    readings: Sequence[Reading],
    offsets: FloatArray,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Positions and velocities before the segments' starts.

    Args:
        segments: the segments.
        states: what was measured in each one's recording.
        shift: (n, n_segments, n_joints) from a segment's start to the simulation's, on the log's
            clock [s].
        readings: of each joint, for arrays (n, n_segments, steps).
        offsets: (n_steps,) instants before the start [s].

    Returns:
        q, qd: (n * n_segments, n_steps, n_joints) each.
        unknown: (n * n_segments, n_steps) whether the recording had not begun.
    """
    n, n_segments, n_joints = shift.shape
    alike = bool((shift == shift[:1]).all())
    some = shift[:1] if alike else shift
    shown = np.empty((2, len(some), n_segments, len(offsets), n_joints))
    for s, (segment, state) in enumerate(zip(segments, states, strict=True)):
        for k in range(n_joints):
            time = segment.start + some[:, s, k, None] + offsets
            for signal, values in zip(shown, state.at(time.reshape(-1)), strict=True):
                signal[:, s, :, k] = values[:, k].reshape(time.shape)
    parts = [
        reading.joint(shown[0, ..., k], shown[1, ..., k]) for k, reading in enumerate(readings)
    ]
    q, qd = (
        np.stack([np.broadcast_to(p[i], (n, *p[i].shape[1:])) for p in parts], -1) for i in (0, 1)
    )
    flat = (n * n_segments, len(offsets), n_joints)
    begun = np.array([float(segment.recording.time[0]) for segment in segments])
    start = np.array([segment.start for segment in segments])
    # A start is moved by delays, not to before the recording.
    unknown = start[:, None] + offsets < begun[:, None] - NEAREST * _shortest(offsets)
    return q.reshape(flat), qd.reshape(flat), np.tile(unknown, (n, 1))


def _shortest(offsets: FloatArray) -> float:
    """The step between instants [s]."""
    return float(np.diff(offsets).min(initial=np.inf)) if len(offsets) > 1 else 0.0


def integral_at_start(
    laws: Laws,
    batch: LockStep,
    state: FloatArray,
    segments: Sequence[Segment],
    routes: Sequence[Sequence[Route]],
    ctrl: FloatArray,
) -> FloatArray | None:
    """Effort of integral action at the segments' starts, or None where there is no such law.

    Args:
        laws: the laws.
        batch: the simulations, of a robot that does not float.
        state: (n_sims, nstate) where they start.
        segments: the segments, of which each variant has all in turn.
        routes: of each, where its targets go.
        ctrl: (n_sims, nu) controls with which they start.

    Returns:
        (n_sims, n_joints) [N·m; N].
    """
    p = dict(laws.stepwise).get(IntegralAction)
    if p is None:
        return None
    n_segments, joints = len(segments), laws.joints
    first_q = np.tile(_first_positions(segments, joints), (len(state) // n_segments, 1))
    ctrl = ctrl.copy()
    for s, segment in enumerate(segments):
        for route in routes[s]:
            if route.drive is not None:
                target = float(segment.recording.whole.columns[route.column][0])
                ctrl[s::n_segments, route.drive.ctrl] = route.drive.control(target)
    still = state.copy()
    qpos, qvel = (
        state_offset(batch.model, component)
        for component in (mujoco.mjtState.mjSTATE_QPOS, mujoco.mjtState.mjSTATE_QVEL)
    )
    still[:, qpos + np.array([joint.qpos for joint in joints])] = first_q
    still[:, qvel : qvel + batch.model.nv] = 0.0
    dofs = [joint.dof for joint in joints]
    bias, passive = (
        batch.forward(still, ctrl=ctrl[:, : batch.model.nu], name=name)[:, dofs]
        for name in ("qfrc_bias", "qfrc_passive")
    )
    asked = laws.forces.asked(ctrl[:, laws.forces.ctrl])
    missing = bias - passive - laws.forces.effort(asked, first_q, np.zeros_like(first_q))
    stiffness = laws.forces.stiffness
    most = np.minimum(p["clamp"], laws.forces.limit)
    # A slow integrator has not settled, and takes over nothing at all as its gain goes to 0.
    settled = -np.expm1(-_SWITCHED_ON * p["gain"] / np.where(stiffness > 0, stiffness, np.inf))
    added = np.clip(settled * missing, -most, most)
    each = [_errors(segment, joints, laws.forces.stiffness[0] > 0) for segment in segments]
    errors = np.zeros((max(len(one) for one in each), n_segments, len(joints)))
    for s, one in enumerate(each):
        errors[: len(one), s] = one
    start, gain, most = (
        values.reshape(-1, n_segments, len(joints)) for values in (added, p["gain"], most)
    )
    return _summed(start, gain, errors, most).reshape(added.shape)


def _summed(
    start: FloatArray, gain: FloatArray, errors: FloatArray, most: FloatArray
) -> FloatArray:
    """Where an integrator within ±`most` gets from a start.

    Args:
        start: (n, n_segments, n_joints).
        gain: of the same shape, by which it multiplies what it sums.
        errors: (n_steps, n_segments, n_joints) that it sums.
        most: as the start.
    """
    if not len(errors):
        return start
    so_far = np.cumsum(errors, axis=0)
    highest, lowest = start + gain * so_far.max(axis=0), start + gain * so_far.min(axis=0)
    held = (highest > most) | (lowest < -most)
    added: FloatArray = start + gain * so_far[-1]
    some = held.any(axis=(1, 2))
    if some.any():
        bounded, per_error, ends = start[some], gain[some], most[some]
        for error in errors:
            bounded = clipped(bounded + per_error * error, -ends, ends)
        added[some] = np.where(held[some], bounded, added[some])
    return added


def _first_positions(segments: Sequence[Segment], joints: Sequence[Joint]) -> FloatArray:
    """(n_segments, n_joints) at the beginning of each segment's recording."""
    return np.array(
        [
            [segment.recording.whole.columns[f"{joint.name}/position"][0] for joint in joints]
            for segment in segments
        ]
    )


def _errors(segment: Segment, joints: Sequence[Joint], servoed: NDArray[np.bool_]) -> FloatArray:
    """Measured errors from a recording's beginning to a segment, (n, n_joints), times durations."""
    log = segment.recording.whole
    before = int(np.searchsorted(log.time, segment.start))
    errors = np.zeros((before, len(joints)))
    for k, joint in enumerate(joints):
        target = log.signal(joint.name, "position_target")
        if target is not None and servoed[k]:
            errors[:, k] = target[:before] - log.columns[f"{joint.name}/position"][:before]
    return errors * np.diff(log.time[: before + 1])[:, None]
