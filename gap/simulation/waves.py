"""The waves that a joint's unexplained effort and position show over its positions.

    waves(robot, recordings, ["knee"])["knee"]   # the most prominent first, of each form

The number of periods of a cogging motor or an eccentric gear is not known, and a fit only finds it
from within a fraction of a period over the joint's whole range. A spectrum over the positions finds
it directly: what the model's inverse dynamics want along the measured motion, less what the drive
made, is regressed on A sin(N q + φ) for every N (Lomb, Astrophysics and Space Science 39, 1976),
beside terms that other effects would leave. Waves of the log alone are looked for by
`reading_waves`. All that is wanted is a start of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.smooth import Smoothed
from walkerkit.gap.simulation.reading_waves import Sense, reading_waves
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest
from walkerkit.gap.simulation.wave import Wave, WaveForm

FloatArray = NDArray[np.float64]

_PEAKS = 2  # of each form
_ROWS = 8000  # of all recordings together
_FEWEST_ROWS, _SHORTEST = 30, 1e-6  # rad or m
_PEAK = 99.5  # percentile of the speed
_SLOWEST = 0.02  # of the peak speed; below, what friction does is unknown
_BANDWIDTH = 2 * np.pi * 15  # rad/s that pass the smoothing of positions
_FEWEST, _MOST = 1.25, 400.0  # periods over the joint's range
_FINENESS = 16  # points of the spectrum per period over the joint's range
_BIN = 0.3  # rad of the fastest wave
_NOTHING = 1e-100  # of the squares of an effort or a motion; what is less has no inverse
_SIGN = 5  # the row of the sign of the velocity among what is regressed beside the waves


@dataclass(frozen=True, kw_only=True)
class _Motion:
    """A joint's measured motion; (n,) each.

    Attributes:
        q, qd, qdd: smoothed position, velocity and acceleration.
        effort: what its drives made.
        residual: what the model wants beyond it.
        error: logged position beyond its target, NaN without a target or a logged effort.
        stiffness, damping: of the effort by position and velocity as they are logged, not as they
            are: of the drives unless their effort is logged, and of the joint.
    """

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    effort: FloatArray
    residual: FloatArray
    error: FloatArray
    stiffness: FloatArray
    damping: FloatArray


def waves(
    robot: Robot, recordings: Sequence[Recording], joints: Sequence[str]
) -> dict[str, tuple[Wave, ...]]:
    """The most prominent waves of every joint that was recorded.

    Args:
        robot: the robot; its nominal drive tells the effort where none was logged.
        recordings: its recordings.
        joints: names of joints.

    Returns:
        Joint to its waves, of each form the most prominent first.
    """
    every = max(1, -(-sum(len(r.time) for r in recordings) // _ROWS))
    parts = [_motions(robot, recording, every) for recording in recordings]
    found: dict[str, tuple[Wave, ...]] = {}
    for joint in joints:
        mine = [part[joint] for part in parts if joint in part]
        if mine:
            whole = _Motion(
                **{
                    name: np.concatenate([getattr(one, name) for one in mine])
                    for name in _Motion.__dataclass_fields__
                }
            )
            inertia = float(robot.model.dof_M0[robot.joints[joint].dof])
            found[joint] = _prominent(whole, inertia)
    return found


def nominal_effort(
    robot: Robot, recording: Recording, joint: str, q: FloatArray, qd: FloatArray
) -> FloatArray | None:
    """Effort of the model's drives at a measured state, (n,), or None where they have no target.

    Args:
        robot: the robot.
        recording: the log, of n samples.
        joint: the joint.
        q: (n,) its positions [rad; m].
        qd: (n,) its velocities [rad/s; m/s].
    """
    model, drives = robot.model, robot.joints[joint].drives
    forward = recording.signal(joint, "effort_target")
    if robot.joints[joint].taker("voltage") is not None:
        forward = None  # it is in volts, if it is there at all
    total = None if any(drive.kind == "effort" for drive in drives) else forward
    for drive in drives:
        target = recording.signal(joint, f"{drive.kind}_target")
        if target is None:
            continue
        if drive.kind == "effort":
            effort = np.array(target)
        elif drive.kind == "position":
            effort = drive.stiffness * (target - q) - drive.damping * qd
        else:
            effort = drive.damping * (target - qd)
        limit = robot.number(joint, "effort_limit") if drive.in_python else None
        if limit is not None:
            effort = np.clip(effort, -limit, limit)
        if model.actuator_forcelimited[drive.actuator]:
            gear = abs(float(model.actuator_gear[drive.actuator, 0]))
            low, high = gear * model.actuator_forcerange[drive.actuator]
            effort = np.clip(effort, low, high)
        total = effort if total is None else total + effort
    return total


def _motions(robot: Robot, recording: Recording, every: int) -> dict[str, _Motion]:
    """The motion of each joint of one recording at every so many samples."""
    names = [name for name in recording.joints if name in robot.joints]
    joints = [robot.joints[name] for name in names]
    time = recording.time
    state = Smoothed(time, np.stack([recording.columns[f"{name}/position"] for name in names]))
    q, qd = state.at(time), state.slope_at(time)
    qdd = Smoothed(time, qd.T).slope_at(time)
    rows = slice(every // 2, None, every)
    inverse = _inverse_dynamics(
        robot, [j.qpos for j in joints], [j.dof for j in joints], q[rows], qd[rows], qdd[rows]
    )
    found = {}
    for k, name in enumerate(names):
        made = recording.signal(name, "effort")
        if made is None:
            made = nominal_effort(robot, recording, name, q[:, k], qd[:, k])
        made = np.zeros(len(time)) if made is None else Smoothed(time, made[None]).at(time)[:, 0]
        found[name] = _Motion(
            q=q[rows, k],
            qd=qd[rows, k],
            qdd=qdd[rows, k],
            effort=made[rows],
            residual=inverse[:, k] - made[rows],
            **{key: values[rows] for key, values in _feedback(robot, recording, name).items()},
        )
    return found


def _feedback(robot: Robot, recording: Recording, joint: str) -> dict[str, FloatArray]:
    """The error, stiffness and damping of `_Motion`, at all samples."""
    drives, logged = robot.joints[joint].drives, recording.signal(joint, "effort") is not None
    taken = [d for d in drives if recording.signal(joint, f"{d.kind}_target") is not None]
    own = float(robot.model.dof_damping[robot.joints[joint].dof])
    target = recording.signal(joint, "position_target")
    position = recording.columns[f"{joint}/position"]
    stiffness = 0.0 if logged else sum(drive.stiffness for drive in taken)
    damping = own if logged else own + sum(drive.damping for drive in taken)
    error = np.full(position.shape, np.nan)
    if logged and target is not None and any(drive.kind == "position" for drive in taken):
        error = position - target
    return {
        "error": error,
        "stiffness": np.full(position.shape, stiffness),
        "damping": np.full(position.shape, damping),
    }


def _inverse_dynamics(
    robot: Robot,
    qposes: Sequence[int],
    dofs: Sequence[int],
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
) -> FloatArray:
    """Efforts that move the model's joints so, without its dry friction, stops and contacts."""
    model = robot.spec.copy().compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = rest(model)
    efforts = np.empty(q.shape)
    for row, (position, velocity, acceleration) in enumerate(zip(q, qd, qdd, strict=True)):
        data.qpos[qposes], data.qvel[dofs], data.qacc[dofs] = position, velocity, acceleration
        mujoco.mj_inverse(model, data)
        efforts[row] = data.qfrc_inverse[dofs]
    return efforts


def _prominent(motion: _Motion, inertia: float) -> tuple[Wave, ...]:
    """The largest peaks of each form's spectrum."""
    speed = np.abs(motion.qd)
    moving = speed > _SLOWEST * np.percentile(speed, _PEAK)
    q, qd = motion.q[moving], motion.qd[moving]
    reach = float(np.ptp(q)) if len(q) >= _FEWEST_ROWS else 0.0
    if reach < _SHORTEST:
        return ()
    origin = float(q.min())
    sign, effort = np.sign(qd), motion.effort[moving]
    highest = float(np.clip(_BANDWIDTH / np.percentile(np.abs(qd), 25), 10 / reach, _MOST / reach))
    terms = np.stack([np.ones_like(q), q, q**2, qd, motion.qdd[moving], sign])
    spectrum = _Spectrum(q - origin, motion.residual[moving], terms, highest=highest)
    found = []
    factors: dict[WaveForm, FloatArray] = {
        "pose": np.ones_like(q),
        "friction": -sign,
        "effort": effort,
    }
    for form, factor in factors.items():
        for periods, sine, cosine, beside in spectrum.peaks(factor):
            found.append(
                Wave(
                    form=form,
                    periods=periods,
                    amplitude=float(np.hypot(sine, cosine)),
                    phase=float(
                        np.angle(np.exp(1j * (np.arctan2(cosine, sine) - periods * origin)))
                    ),
                    mean=-float(beside[_SIGN]) if form == "friction" else 0.0,
                )
            )
    error, zero = motion.error[moving], np.zeros_like(q)
    servoed = bool(np.isfinite(error).all())
    read = reading_waves(
        q,
        error if servoed else motion.residual[moving],
        np.concatenate([terms, effort[None]]) if servoed else terms,
        Sense(
            position=zero + 1 if servoed else motion.stiffness[moving],
            velocity=zero if servoed else motion.damping[moving],
            acceleration=zero if servoed else zero + inertia,
            qd=qd,
            qdd=motion.qdd[moving],
        ),
        highest=highest,
        most=_PEAKS,
    )
    for amplitude, periods, phase in read:
        found.append(Wave(form="position", periods=periods, amplitude=amplitude, phase=phase))
    return tuple(found)


class _Spectrum:
    """A series regressed on factor · sin(N x), factor · cos(N x) and terms beside them, for all N.

    Sums over the samples are spectra of histograms over x, so that all N cost one transform.

    Args:
        x: (n,) positions from zero on [rad; m].
        series: (n,) what to explain.
        beside: (k, n) the other terms.
        highest: the largest N.
    """

    def __init__(self, x: FloatArray, series: FloatArray, beside: FloatArray, *, highest: float):
        self._series, self._beside = series, beside
        reach = float(x.max())
        width = _BIN / highest
        self._bins = (x / width).astype(np.intp)
        self._length = next_fast_len(int(_FINENESS * (reach / width + 1)), real=True)
        step = 2 * np.pi / (self._length * width)
        self.periods = step * np.arange(1, int(highest / step) + 1)
        self._centre = 0.5 * width
        self._apart = int(np.ceil(2 * np.pi / reach / step))
        self._lowest = int(np.ceil(_FEWEST * 2 * np.pi / reach / step))

    def _sums(self, weights: FloatArray, multiple: int = 1) -> NDArray[np.complex128]:
        """Σ w exp(i N x) for every N, or for multiples of it."""
        histogram = np.bincount(self._bins, weights, minlength=int(self._bins.max()) + 1)
        every = np.fft.fft(histogram, self._length).conj()
        at = (multiple * np.arange(1, len(self.periods) + 1)) % self._length
        turned: NDArray[np.complex128] = every[at] * np.exp(
            1j * multiple * self.periods * self._centre
        )
        return turned

    def peaks(self, factor: FloatArray) -> list[tuple[float, float, float, FloatArray]]:
        """The most prominent N, each with the coefficients of sine, cosine and of the terms beside.

        Args:
            factor: (n,) what multiplies the waves.
        """
        squares = 0.5 * float(factor @ factor)
        if squares < _NOTHING:
            return []
        gram = self._beside @ self._beside.T
        known = self._beside @ self._series
        inverse = np.linalg.pinv(gram, hermitian=True)
        alone = self._sums(factor * self._series)
        twice = 0.5 * self._sums(factor**2, 2)
        cross = np.stack([self._sums(factor * term) for term in self._beside])
        waves = np.stack([cross.imag, cross.real])  # (2, k, N)
        target = np.stack([alone.imag, alone.real]) - np.einsum("akn,k->an", waves, inverse @ known)
        normal = np.array([[squares - twice.real, twice.imag], [twice.imag, squares + twice.real]])
        normal -= np.einsum("akn,kl,bln->abn", waves, inverse, waves)
        normal[[0, 1], [0, 1]] += 1e-9 * squares
        coefficients = np.linalg.solve(normal.transpose(2, 0, 1), target.T[..., None])[..., 0]
        gain = np.einsum("na,an->n", coefficients, target)
        gain[: self._lowest] = 0
        found = []
        for _ in range(_PEAKS):
            k = int(np.argmax(gain))
            if gain[k] <= 0:
                break
            rest_of = inverse @ (known - waves[:, :, k].T @ coefficients[k])
            found.append((float(self.periods[k]), *map(float, coefficients[k]), rest_of))
            gain[max(0, k - self._apart) : k + self._apart + 1] = 0
        return found
