"""`mujoco.sysid` on a problem of ours: armature, damping and frictionloss of each joint, or more.

    fit = identify(gap.load("arm.xml", ["a.csv", "b.csv"]))     # needs the extra mujoco[sysid]
    gap.replay(problem, fit.robots).gap

Its optimizer, residual and rollouts work on what `gap.fit` works on: the fitted recordings, cut as
our replays are (whole, or windows), each from its measured state; commands on the timestep's grid
under the problem's hold; the signals that are scored; one set of values for the joints of all
models, which are a `ModelSequences` each. Starts and bounds are those of the catalogue's effects.

Two things are not as it has them by itself, both to its advantage. Residuals are normalised by each
signal's size in all recordings: that of each sequence is next to nothing in a window in which a
joint rests. And dry friction is as stiff as our fits make it, since it creeps at MuJoCo's default
time constant. Steps are scaled by the Jacobian, as it recommends where units differ.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.commands import Hold, between_samples, routes
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_SENSORS = {
    "position": mujoco.mjtSensor.mjSENS_JOINTPOS,
    "effort": mujoco.mjtSensor.mjSENS_JOINTACTFRC,
}
EFFECTS = ("armature", "viscous_friction", "coulomb_friction")
# Keeps its resampling from adding a step to a grid that is the timestep's but for rounding.
_ON_GRID = 1 - 1e-12


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What `mujoco.sysid` found.

    Attributes:
        values: `joint/parameter` to its value, added to what the models have.
        robots: the robots with these values, one per experiment.
    """

    values: dict[str, float]
    robots: tuple[Robot, ...]


def available() -> bool:
    """Whether the packages of the extra `mujoco[sysid]` are installed."""
    return hasattr(sysid, "optimize")


def identify(
    problem: Problem, *, effects: Sequence[str] = EFFECTS, iterations: int = 100
) -> Identified:
    """Fits the recordings that are not held out.

    Args:
        problem: what `gap.load` returned.
        effects: whose parameters, of effects that are fields of the model and nothing else.
        iterations: the most that the optimizer may take.

    Raises:
        ValueError: a recording has feed-forward effort, which its rollouts cannot apply.
    """
    terms = candidate_terms([CATALOGUE[n] for n in effects], problem.robots, problem.joints)
    structure = Structure(terms, problem.robots)
    parameters = sysid.ParameterDict()
    for slot, lower, upper in zip(structure.slots, *structure.bounds, strict=True):
        start = float(np.clip(slot.parameter.starts[0], lower, upper))
        name = f"{slot.place}/{slot.parameter.name}"
        parameters.add(sysid.Parameter(name, start, lower, upper))
    models = [_Model(structure, replay, problem) for replay in problem.fit.told]
    compiled = {id(model.sequences.spec): model for model in models}
    residual = sysid.build_residual_fn(
        models_sequences=[model.sequences for model in models],
        build_model=lambda p, spec: compiled[id(spec)].with_values(p.as_vector()),
        modify_residual=_Residual(problem.channels, _sizes(problem)),
    )
    found, _ = sysid.optimize(
        parameters,
        residual,
        verbose=False,
        max_iters=iterations,
        x_scale="jac",
        output=io.StringIO(),  # it prints every step, whatever `verbose` says
    )
    values = found.as_vector()
    return Identified(
        values=dict(zip(found.keys(), map(float, values), strict=True)),
        robots=tuple(mend(structure.trials(r, values[None])) for r in problem.robots),
    )


class _Model:
    """One robot with its measured sequences, and itself at any values."""

    def __init__(self, structure: Structure, replay: Replay, problem: Problem):
        spec = replay.robot.spec.copy()
        for channel in problem.channels:
            spec.add_sensor(
                name=_sensor(channel),
                type=_SENSORS[channel.signal],
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=channel.joint,
            )
        self._robot = replace(replay.robot, spec=spec, model=spec.compile())
        self._structure = structure
        self._compiled: dict[bytes, mujoco.MjModel] = {}
        rows = [_sequence(self._robot, s, problem.channels, problem.hold) for s in replay.segments]
        starts, controls, measured = zip(*rows, strict=True)
        self.sequences = sysid.ModelSequences(
            replay.robot.stem,
            spec,
            [f"{s.recording.name} {s.start:.2f} s" for s in replay.segments],
            starts,
            controls,
            measured,
        )

    def with_values(self, values: FloatArray) -> mujoco.MjModel:
        """The compiled model; those of one Jacobian are asked for again by each sequence."""
        key = values.tobytes()
        if key not in self._compiled:
            if len(self._compiled) > 2 * len(values):
                self._compiled.clear()
            trials = self._structure.trials(self._robot, values[None])
            self._compiled[key] = mend(trials).model
        return self._compiled[key]


def _sequence(
    robot: Robot, segment: Segment, channels: Sequence[Channel], hold: Hold
) -> tuple[FloatArray, Any, Any]:
    """Initial state, controls and measured signals of one segment, the start itself left out."""
    model, recording = robot.model, segment.recording
    step = model.opt.timestep
    steps = int(np.ceil(segment.duration / step - 1e-6)) + 1
    grid = step * np.arange(steps)
    controls = np.zeros((steps, model.nu))
    for route in routes(robot, recording):
        if route.drive is None:
            raise ValueError(f"{recording.name}: {route.column} is applied beside the drive")
        sent = between_samples(recording, route.column, segment.start + grid, hold, step)
        controls[:, route.drive.ctrl] = route.drive.control(sent)
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    joints = [robot.joints[name] for name in recording.joints]
    q, v = MeasuredState(recording, recording.joints).at(np.array([segment.start]))
    qpos[[j.qpos for j in joints]], qvel[[j.dof for j in joints]] = q[0], v[0]
    time = recording.time[segment.first : segment.last] - segment.start
    shown = (time >= step) & (time <= grid[-1])
    columns = []
    for channel in channels:
        column = channel.measured(recording)
        if column is None:
            columns.append(np.full(int(shown.sum()), np.nan))
            continue
        # Its rollout reads sensors as a step begins, and stamps them as it ends.
        late = step if channel.signal == "effort" else 0.0
        columns.append(np.interp(segment.start + time[shown] - late, recording.time, column))
    return (
        sysid.create_initial_state(model, qpos, qvel),
        sysid.TimeSeries(_ON_GRID * grid, controls),
        sysid.TimeSeries(time[shown], np.stack(columns, axis=1), _mapping(channels)),
    )


class _Residual:
    """Simulated signals at the measured times, less the measured ones."""

    def __init__(self, channels: Sequence[Channel], sizes: FloatArray):
        self._channels = channels
        self._sizes = sizes

    def __call__(
        self,
        params: Any,
        simulated: Any,
        measured: Any,
        model: mujoco.MjModel,
        return_pred_all: bool,
        *,
        state: FloatArray,
    ) -> tuple[FloatArray, Any, Any]:
        """As `mujoco.sysid` asks for it."""
        columns = []
        for channel in self._channels:
            if channel.signal == "position":
                columns.append(state[:, 1 + int(model.joint(channel.joint).qposadr[0])])
            else:
                columns.append(simulated.data[:, model.sensor(_sensor(channel)).adr[0]])
        shown = sysid.TimeSeries(state[:, 0], np.stack(columns, axis=1), measured.signal_mapping)
        shown = shown.resample(measured.times)
        residual = sysid.weighted_diff(shown.data, measured.data) / self._sizes
        return np.where(np.isnan(measured.data), 0.0, residual), shown, measured


def _sizes(problem: Problem) -> FloatArray:
    """(n_channels,) norms of the measured signals over all recordings that are fitted."""
    replays = problem.fit.told
    columns = [replays[0].channels.index(channel) for channel in problem.channels]
    measured = np.concatenate([replay.measured[:, columns] for replay in replays])
    return np.sqrt(np.nansum(measured**2, axis=0))


def _mapping(channels: Sequence[Channel]) -> dict[str, tuple[Any, NDArray[np.int64]]]:
    kind = sysid.SignalType.CustomObs
    return {_sensor(channel): (kind, np.array([c])) for c, channel in enumerate(channels)}


def _sensor(channel: Channel) -> str:
    return f"{channel.joint}/{channel.signal}"
