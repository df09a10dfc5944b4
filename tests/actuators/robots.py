"""A small robot for the tests of the actuators, and how to run it one by one and in a batch."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from dm_control import composer, mjcf
from mujoco.batch import Batch

from walkerkit.actuators import ActuatorCmd

# In kinematic order: a ball joint and a motor of its own come before the three joints that the
# tests drive, so that neither ids nor addresses are what they would be by chance.
ROBOT = """
<mujoco model="robot">
  <compiler angle="radian"/>
  <option timestep="0.002"><flag contact="disable"/></option>
  <default>{default}</default>
  <worldbody>
    <body name="torso"><geom size="0.1" mass="4"/>
      <body name="tail"><joint name="tail" type="ball"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 -0.2 0 0" mass="0.3"/></body>
      <body name="spare"><joint name="spare" axis="1 0 0"/><geom size="0.05" pos="0 0.1 0"/></body>
      <body name="thigh"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.05"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
        <body name="shin" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" frictionloss="0.02"/>
          <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.5"/>
          <body name="foot" pos="0 0 -0.3"><joint name="rail" type="slide" axis="0 0 1"/>
            <geom size="0.04" mass="0.4"/><site name="sole"/></body></body></body>
    </body>
  </worldbody>
  <tendon><fixed name="pair"><joint joint="hip" coef="0.5"/><joint joint="knee" coef="-2"/></fixed>
    <fixed name="lone"><joint joint="rail" coef="3"/></fixed></tendon>
  <actuator><motor name="spare" joint="spare"/>{actuator}</actuator>
</mujoco>
"""
JOINTS = ("hip", "knee", "rail")
EXPRESSIONS = ("rail", "k.*", "hip")
POSE = {"hip": 0.3, "knee": -0.5, "rail": 0.05}
TIMESTEP = 0.002
WORDS = ("position", "velocity", "effort")


def robot(actuator="", default=""):
    """The robot's model, not yet compiled."""
    return mjcf.from_xml_string(ROBOT.format(actuator=actuator, default=default))


def free(root):
    """The model of an arena in which the robot floats."""
    arena = mjcf.RootElement(model="arena")
    arena.option.timestep = root.option.timestep
    arena.attach(root).add("freejoint")
    return arena


def compiled(root):
    """Physics of the robot in an arena; compiled anew where it is in one already."""
    if root.root_model is root:
        free(root)
    return mjcf.Physics.from_mjcf_model(root.root_model)


def built(cfg, root):
    """The actuator of a config, initialized with one physics, and the physics."""
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    physics = compiled(root)
    actuator.initialize(physics)
    place(physics)
    actuator.reset()
    return actuator, physics


def batch_of(physics, n_sims):
    """A batch of simulations of a physics' model, in the robot's pose."""
    batch = Batch(physics.model.ptr, n_sims, 1)
    place(batch)
    return batch


def place(physics, rows=None):
    """Resets the state to the robot's pose, of all simulations or of some rows."""
    if isinstance(physics, Batch):
        batch = physics
        batch.reset(rows)
        for name, value in POSE.items():
            at = batch.model.jnt_qposadr[_joint(batch.model, name)]
            batch.qpos[slice(None) if rows is None else rows, at] = value
        batch.forward(rows, stage=mujoco.mjtStage.mjSTAGE_VEL)
        return
    with physics.reset_context():
        model = physics.model.ptr
        for name, value in POSE.items():
            physics.data.qpos[model.jnt_qposadr[_joint(model, name)]] = value


def _joint(model, name):
    ids = [model.joint(prefix + name).id for prefix in ("robot/", "") if _has(model, prefix + name)]
    return ids[0]


def _has(model, name):
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0


@dataclass
class Record:
    """What happened, (n_steps, ..., n)."""

    qpos: np.ndarray
    ctrl: np.ndarray
    computed: np.ndarray
    applied: np.ndarray
    exerted: np.ndarray

    def __eq__(self, other):
        return all(
            np.array_equal(a, b) for a, b in zip(self._arrays(), other._arrays(), strict=True)
        )

    def row(self, i):
        """One simulation of a batch."""
        return Record(*(array[:, i] for array in self._arrays()))

    def part(self, steps):
        """Some of the steps."""
        return Record(*(array[steps] for array in self._arrays()))

    def _arrays(self):
        return self.qpos, self.ctrl, self.computed, self.applied, self.exerted


def run(actuator, physics, commands, before=None):
    """Steps a physics or a batch under an actuator, with one command per step.

    `before(k)` is called ahead of step k. `exerted` is MuJoCo's force on each degree of freedom.
    """
    record = Record([], [], [], [], [])
    timestep = TIMESTEP
    data = physics if isinstance(physics, Batch) else physics.data
    if not isinstance(physics, Batch):
        timestep = physics.timestep()
    else:
        physics.bind("qfrc_actuator")
    for k, cmd in enumerate(commands):
        if before is not None:
            before(k)
        actuator.update(timestep)
        controls = actuator.compute(cmd)
        data.ctrl[..., actuator.ctrl_ids] = controls
        record.ctrl.append(np.array(controls))
        record.computed.append(actuator.computed_effort)
        record.applied.append(actuator.applied_effort)
        if isinstance(physics, Batch):
            # As dm_control's step, which leaves derived fields at the new state.
            physics.step(stage=mujoco.mjtStage.mjSTAGE_VEL)
        else:
            physics.step()
        record.qpos.append(np.array(data.qpos))
        record.exerted.append(np.array(data.qfrc_actuator))
    return Record(*(np.array(array) for array in record._arrays()))


def commands(n_steps, shape, words, *, seed=0, scale=0.4, hold=3):
    """Random targets, each held for a few steps."""
    rng = np.random.default_rng(seed)
    every = []
    for k in range(n_steps):
        if k % hold == 0:
            cmd = ActuatorCmd(**{f"{w}_target": scale * rng.standard_normal(shape) for w in words})
        every.append(cmd)
    return every


def changed(cmd, change):
    """The command with every target changed."""
    targets = {f"{w}_target": getattr(cmd, f"{w}_target") for w in WORDS}
    return ActuatorCmd(
        **{name: change(target) for name, target in targets.items() if target is not None}
    )


class Arena(composer.Arena):
    """An arena with the walker floating in it."""

    def _build(self, walker):
        super()._build(name="arena")
        self.attach(walker).add("freejoint")


class Task(composer.NullTask):
    """Leaves the controls to the walker."""

    def before_step(self, physics, action, random_state):
        pass


class Walker(composer.Entity):
    """The robot as composer has it, whose group of actuators runs at every substep."""

    def _build(self, root, group, script):
        self._root, self.group, self.script = root, group, script
        self.qpos = []

    @property
    def mjcf_model(self):
        return self._root

    def after_compile(self, physics, random_state):
        self.group.initialize(physics)

    def initialize_episode(self, physics, random_state):
        place(physics)
        self.group.reset()
        self.qpos = []

    def before_substep(self, physics, random_state):
        self.group.update(physics.timestep())
        self.group.apply(self.script[len(self.qpos)])

    def after_substep(self, physics, random_state):
        self.qpos.append(np.array(physics.data.qpos))
