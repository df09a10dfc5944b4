"""The machine that the effects are planted in: a leg of two joints, stepped by hand."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole, windows
from walkerkit.gap.simulation.channel import Channel, base_channels
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay

STEP = 0.002
WINDOW = 0.5
JOINTS = ("hip", "knee")
ADDRESSES = ("qposadr", "dofadr")
LEG = """
<mujoco><compiler angle="{angle}"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="thigh"><joint name="hip" axis="1 0 0" damping="0.2" armature="0.01" {hip}/>
  <geom type="capsule" fromto="0 0 0 0.05 0 -0.3" size="0.03" mass="1"/>
  <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.1" {knee}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>
"""
PLAIN = {
    "angle": "radian",
    "hip": "",
    "knee": "",
    "actuators": '<position name="h" joint="hip" kp="60" kv="2"/>'
    '<position name="k" joint="knee" kp="30" kv="1" forcerange="-20 20"/>',
}
# Everything that an effect could trip over, on one robot.
AWKWARD = {
    "angle": "degree",
    "hip": 'stiffness="1.7" springref="13" range="-90 70" limited="true" ref="5"',
    "knee": 'frictionloss="0.13" stiffness="0.3" range="-80 80" limited="true"',
    "actuators": '<general name="h" joint="hip" gear="-2" biastype="affine" gainprm="20" '
    'biasprm="3 -15 -0.5" ctrlrange="-1 1" forcerange="-11 12"/>'
    '<position name="k" joint="knee" kp="30" kv="0" delay="0.006" nsample="3"/>',
}
SIGNALS = ("position", "effort")
CHANNELS = tuple(Channel(joint=joint, signal=signal) for signal in SIGNALS for joint in JOINTS)
NOISE = {"position": 1e-4, "effort": 0.01, "base_position": 2e-5, "base_orientation": 2e-5}


def robot_of(variant, voltage=None):
    robot = robot_from_spec(mujoco.MjSpec.from_string(LEG.format(**variant)), "leg.xml")
    machine = Machine(robot)
    machine.voltage = voltage
    recording = machine.log()
    return replace(robot, excursions=excursions(robot, [recording], JOINTS)), recording


def replay_of(robot, recording):
    """Its replay: in one go, or in windows where the base floats."""
    channels = CHANNELS + base_channels([recording])
    segments = whole(recording) if robot.base is None else windows(recording, WINDOW)
    return Replay(robot, segments, channels)


def commands(time):
    """Targets that rest, swing fast and slow, and turn around; (n, 2) rad."""
    t = np.maximum(time - 0.2, 0)
    hip = 0.35 * np.sin(3 * t + 0.4 * t**2) + 0.15 * np.sign(np.sin(2.1 * t))
    triangle = 2 / np.pi * np.arcsin(np.sin(1.7 * t))
    knee = 0.5 * triangle + 0.2 * np.sin(9 * t) + 0.15 * (np.sin(1.3 * t) > 0.4)
    return np.stack([hip * (time > 0.2), 0.3 + knee * (time > 0.2)], axis=1)


@dataclass
class Now:
    """One step of the machine, of hip and knee, as its parts find and leave it.

    Attributes:
        time: since the log's beginning, negative before it [s].
        q, qd: at the joints.
        target: position targets; controllers change them.
        effort: what the drives make and report; drives change it.
        ahead: what they report at a step's beginning over what they make in it.
        extra: effort at the joints besides; gears change it.
        friction: dry friction besides the model's; gears change it.
    """

    time: float
    q: np.ndarray
    qd: np.ndarray
    target: np.ndarray
    effort: np.ndarray = field(default_factory=lambda: np.zeros(2))
    ahead: np.ndarray = field(default_factory=lambda: np.zeros(2))
    extra: np.ndarray = field(default_factory=lambda: np.zeros(2))
    friction: np.ndarray = field(default_factory=lambda: np.zeros(2))


Part = Callable[[Now], None]


class Machine:
    """The real robot: the model stepped by hand, with what an effect plants in it.

    Attributes:
        model: the plain MuJoCo model, to be written to; or another one with the same joints. Its
            timestep may be a whole part of `STEP`.
        controller, drive, gear: parts of the robot that MuJoCo does not have, each called once a
            step with a `Now` to change: before the drives, after them, and last.
        command_age, sensor_age: steps.
        applied: constant effort that no drive knows of, per joint.
        offset: of the encoders, which drive and log both see.
        effort_factor: logged over true effort.
        shown: what the log shows of the joints' positions, of (..., 2) what the drives see.
        clock: seconds of the log's clock per second, from the log's beginning.
        voltage: of the supply at a time of the log, which then has a column of it.
    """

    def __init__(self, robot):
        self.robot = robot
        self.model = robot.spec.copy().compile()
        self.controller: Part | None = None
        self.drive: Part | None = None
        self.gear: Part | None = None
        self.command_age = self.sensor_age = 0
        self.applied, self.offset, self.effort_factor = np.zeros(2), np.zeros(2), np.ones(2)
        self.shown: Callable[[np.ndarray], np.ndarray] = np.array
        self.clock = 1.0
        self.voltage: Callable[[np.ndarray], np.ndarray] | None = None

    def log(self, seconds=4.0, seed=None):
        model = self.model
        mujoco.mj_setConst(model, mujoco.MjData(model))
        data, settle = mujoco.MjData(model), 1000
        steps = round(seconds / STEP)
        time = STEP * np.arange(steps)
        targets = commands(time)
        joints = [model.joint(name) for name in JOINTS]
        at, dofs = (np.concatenate([getattr(j, name) for j in joints]) for name in ADDRESSES)
        dry = model.dof_frictionloss[dofs]
        rows, poses = [], []
        for k in range(-settle, steps):
            now = Now(
                time=k * STEP,
                q=data.qpos[at],
                qd=data.qvel[dofs],
                target=commands(np.array([max(0, k - self.command_age) * STEP]))[0] - self.offset,
            )
            if self.controller is not None:
                self.controller(now)
            for name, target in zip(JOINTS, now.target, strict=True):
                drive = self.robot.joints[name].drives[0]
                data.ctrl[drive.ctrl] = drive.control(float(target))
            pose = data.qpos.copy()
            mujoco.mj_step1(model, data)
            mujoco.mj_fwdActuation(model, data)
            native = data.qfrc_actuator[dofs]
            now.effort = native.copy()
            if self.drive is not None:
                self.drive(now)
            if self.gear is not None:
                self.gear(now)
            model.dof_frictionloss[dofs] = dry + now.friction
            data.qfrc_applied[dofs] = self.applied + now.effort - native + now.extra
            for _ in range(round(STEP / model.opt.timestep)):
                mujoco.mj_step(model, data)
            rows.append(
                np.r_[
                    self.shown(now.q + self.offset), (now.effort + now.ahead) * self.effort_factor
                ]
            )
            poses.append(pose)
        rows = np.array(rows)
        position, effort = np.split(rows, 2, axis=1)
        position = position[settle - self.sensor_age : settle - self.sensor_age + steps]
        effort = effort[settle:]
        if self.clock != 1:
            then = time / self.clock
            position = np.stack([np.interp(then, time, column) for column in position.T], axis=1)
            # Targets are others at each step, and effort jumps with them.
            effort = effort[np.floor(then / STEP + 1e-9).astype(int).clip(0, steps - 1)]
        if seed is not None:
            rng = np.random.default_rng(seed)
            position = position + NOISE["position"] * rng.normal(size=position.shape)
            effort = effort + NOISE["effort"] * rng.normal(size=effort.shape)
        columns = {}
        for k, joint in enumerate(JOINTS):
            columns[f"{joint}/position"] = position[:, k]
            columns[f"{joint}/effort"] = effort[:, k]
            columns[f"{joint}/position_target"] = targets[:, k]
        if self.voltage is not None:
            columns["voltage"] = self.voltage(time)
        if self.robot.base is not None:
            first = self.robot.base.qpos
            pose = np.array(poses[settle:])[:, first : first + 7]
            if seed is not None:
                for row, noise in zip(pose, rng.normal(size=(len(pose), 6)), strict=True):
                    row[:3] += NOISE["base_position"] * noise[:3]
                    mujoco.mju_quatIntegrate(row[3:], NOISE["base_orientation"] * noise[3:], 1.0)
            names = (*(f"position_{axis}" for axis in "xyz"), *(f"quaternion_{a}" for a in "wxyz"))
            columns |= {f"base/{name}": pose[:, k] for k, name in enumerate(names)}
        return Recording(name="log", time=time, columns=columns)
