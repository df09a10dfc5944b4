"""A simulated arm whose drive has a law of its own, stepped by hand in finer steps."""

from __future__ import annotations

import mujoco
import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.tasks.excitation import BATTERY

JOINT = "shaft"
STEP = 0.002
ARM = """
<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="arm"><joint name="shaft" axis="0 1 0" range="-1.6 1.6" damping="0.05"
    armature="0.005"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body>
  </worldbody><actuator><position joint="shaft" kp="20" kv="0.6"/></actuator></mujoco>
"""
NOISE, EFFORT_NOISE = 1e-4, 0.01


def servo(error, qd):
    """The law that the model has."""
    return 20.0 * error - 0.6 * qd


def soft(error, qd):
    """A law that no gains make: weak for small errors."""
    return 60.0 * error**3 + 6.0 * error - 0.4 * qd


def nothing(q, qd):
    """No force beside the drive."""
    return 0.0


def logs(drive=servo, beside=nothing, seconds=3.0, seed=0):
    """Three experiments.

    Args:
        drive: effort of position error and velocity.
        beside: effort at the joint of position and velocity, which no drive reports.
        seconds: length of each.
        seed: of motion and noise.
    """
    found = []
    for number, name in enumerate(("chirp", "slow_triangle", "multisine")):
        rng = np.random.default_rng(100 * seed + number)
        time = np.arange(0.0, seconds, STEP)
        room = {"lower": np.array([-0.6]), "upper": np.array([0.6])}
        targets = BATTERY[name](time, **room, rng=rng, max_velocity=5.0)[:, 0]
        q, effort = _run(drive, beside, targets)
        columns = {
            f"{JOINT}/position": q + NOISE * rng.standard_normal(len(q)),
            f"{JOINT}/position_target": targets,
            f"{JOINT}/effort": effort + EFFORT_NOISE * rng.standard_normal(len(q)),
        }
        found.append(Recording(name=name, time=time, columns=columns))
    return found


def _run(drive, beside, targets):
    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.timestep = STEP / 4
    model.actuator_gainprm[0], model.actuator_biasprm[0] = 0.0, 0.0
    data = mujoco.MjData(model)
    data.qpos[0] = targets[0]
    positions, efforts = [], []
    for row, target in enumerate([*500 * [targets[0]], *targets]):
        for k in range(4):
            q, qd = data.qpos[0], data.qvel[0]
            effort = drive(target - q, qd)
            if k == 0 and row >= 500:
                positions.append(q)
                efforts.append(effort)
            data.qfrc_applied[0] = effort + beside(q, qd)
            mujoco.mj_step(model, data)
    return np.array(positions), np.array(efforts)
