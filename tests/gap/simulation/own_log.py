"""A model's own log: MuJoCo runs it, and what the robot would have logged is written down."""

from __future__ import annotations

import mujoco
import numpy as np

from walkerkit.actuators.drive import on_joint, read_inputs
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.trials import Trials

STEPS = 4  # of the simulation to a row
MOVES = {"position": 0.3, "velocity": 0.8, "effort": 0.4, "voltage": 1.5}
_STILL, _SETTLE = 0.25, 3.0  # s
SIGNALS = ("position", "velocity", "effort")


def own_log(model, rows=130, seed=0, hidden=(), scale=1.0):
    """Targets of each actuator, held from row to row, and what the model makes of them.

    Args:
        model: the compiled model.
        rows: of the log.
        seed: of the targets.
        hidden: joints that are not logged.
        scale: of the targets.

    Returns:
        Column to samples, `time` among them.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(seed)
    columns = {"time": np.arange(rows) * STEPS * model.opt.timestep}
    joints = {model.joint(j).name: j for j in range(model.njnt) if model.jnt_type[j] >= 2}
    drives = {}
    for a in range(model.nactuator):
        joint = on_joint(model, a)
        for drive in read_inputs(model, a):
            column = f"{model.actuator(a).name}/{drive.kind}_target"
            if joint is not None:
                own = f"{model.joint(joint).name}/{drive.kind}_target"
                column = column if own in drives else own
            drives[column] = drive
    for column, drive in drives.items():
        rate, phase = rng.uniform(3, 9), rng.uniform(0, 6)
        time = columns["time"]
        wave = MOVES[drive.kind] * (np.sin(rate * time + phase) + 0.5 * (np.floor(7 * time) % 2))
        # From rest, so that the state at the start is known and its past does not matter.
        columns[column] = scale * wave * np.clip((time - _STILL) / 0.05, 0.0, 1.0)
        if drive.kind == "position":
            output = model.actuator_outadr[drive.actuator]
            columns[column] += (data.actuator_length[output] - drive.offset) / drive.slope
    columns |= {f"{n}/{s}": np.zeros(rows) for n in joints if n not in hidden for s in SIGNALS}
    for column, drive in drives.items():
        data.ctrl[drive.ctrl] = drive.control(float(columns[column][0]))
    _fill_histories(model, data)
    for _ in range(round(_SETTLE / model.opt.timestep)):
        mujoco.mj_step(model, data)
    for row in range(rows):
        for column, drive in drives.items():
            data.ctrl[drive.ctrl] = drive.control(float(columns[column][row]))
        for name, joint in joints.items():
            if name in hidden:
                continue
            columns[f"{name}/position"][row] = data.qpos[model.jnt_qposadr[joint]]
            columns[f"{name}/velocity"][row] = data.qvel[model.jnt_dofadr[joint]]
        for step in range(STEPS):
            mujoco.mj_step(model, data)
            if step == 0:
                for name, joint in joints.items():
                    if name not in hidden:
                        effort = data.qfrc_actuator[model.jnt_dofadr[joint]]
                        columns[f"{name}/effort"][row] = effort
    return columns


def _fill_histories(model, data):
    """Lets the first controls stand for all before them; MuJoCo's own past is zeros."""
    for actuator in range(model.nactuator):
        samples = int(model.actuator_history[actuator, 0])
        if samples:
            first, width = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
            times = model.opt.timestep * np.arange(-samples, 0)
            values = np.tile(data.ctrl[first : first + width], (samples, 1))
            mujoco.mj_initCtrlHistory(model, data, actuator, times, values)


def gaps(xml, columns):
    """How far the replay of a log is from it, over how far it moves: signal to the largest."""
    robot = robot_from_spec(mujoco.MjSpec.from_string(xml), "own.xml")
    time = columns["time"]
    recording = Recording(
        name="own", time=time, columns={k: v for k, v in columns.items() if k != "time"}
    )
    channels = [Channel(joint=j, signal=s) for j in recording.joints for s in SIGNALS]
    segment = Segment(recording=recording, first=0, last=len(time))
    replay = Replay(robot, [segment], channels, n_threads=1)
    (predicted,) = replay.predict(Trials(robot, 1))
    found = {}
    for c, channel in enumerate(channels):
        measured = replay.measured[:, c]
        size = max(float(np.ptp(measured)), 1e-6)
        gap = float(np.abs(predicted[:, c] - measured).max()) / size
        found[channel.signal] = max(found.get(channel.signal, 0.0), gap)
    return found
