"""Robots and tasks for the tests of the walkers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from dm_control import composer
from dm_control.locomotion.arenas import corridors as corridor_arenas
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.soccer import pitch, team
from dm_control.locomotion.soccer import task as soccer
from dm_control.locomotion.tasks import corridors, go_to_target

from walkerkit.actuators import (
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.walkers import MjcfWalker

# Four legs of two joints; the rear knees have actuators of their own, of which `spare` is one that
# moves nothing that the tests drive.
_LEG = """
<body name="{0}_thigh" pos="{1} {2} 0"><joint name="{0}_hip" axis="0 1 0" range="-1 1"/>
  <geom name="{0}_thigh" type="capsule" size="0.03" fromto="0 0 0 0 0 -0.15" mass="0.5"/>
  <body name="{0}_shin" pos="0 0 -0.15"><joint name="{0}_knee" axis="0 1 0" range="-2 0"/>
    <geom name="{0}_shin" type="capsule" size="0.025" fromto="0 0 0 0 0 -0.15" mass="0.3"/>
  </body></body>"""
LEGS = {"fl": (0.2, 0.1), "fr": (0.2, -0.1), "rl": (-0.2, 0.1), "rr": (-0.2, -0.1)}
DOG = f"""
<mujoco model="dog">
  <compiler angle="radian"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <default><joint damping="0.05" armature="0.01"/></default>
  <worldbody>
    <light name="sun" pos="0 0 3"/>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="trunk" pos="0 0 0.5"><freejoint name="root"/>
      <geom name="trunk" type="box" size="0.25 0.1 0.05" mass="4"/>
      {"".join(_LEG.format(name, *place) for name, place in LEGS.items())}
    </body>
  </worldbody>
  <actuator>
    <position name="rl_knee" joint="rl_knee" kp="30" ctrlrange="-2 0"/>
    <motor name="rr_knee" joint="rr_knee" gear="20"/>
  </actuator>
  <sensor><touch name="unused" site="sole"/><actuatorfrc name="knee_force" actuator="rl_knee"/>
  </sensor>
  <keyframe>
    <key name="curled" qpos="0 0 0.2 1 0 0 0  0.8 -1.8 0.8 -1.8 0.8 -1.8 0.8 -1.8"/>
    <key name="home" qpos="0 0 0.29 1 0 0 0  0.4 -0.8 0.4 -0.8 0.4 -0.8 0.4 -0.8"/>
  </keyframe>
</mujoco>
""".replace('<touch name="unused" site="sole"/>', "")
DOG_JOINTS = tuple(f"{leg}_{joint}" for leg in LEGS for joint in ("hip", "knee"))
DOG_HOME = np.array([0.4, -0.8] * 4)

KP, KD = 25.0, 0.5
EXPLICIT = IdealPdActuatorCfg(joint_names_expr=("f._hip",), stiffness=KP, damping=KD)
NATIVE = BuiltinPositionActuatorCfg(joint_names_expr=("f._knee",), stiffness=30.0, damping=0.5)
LAG = 2
DELAYED = DelayedActuatorCfg(
    base_cfg=DcMotorActuatorCfg(
        joint_names_expr=("r._hip",),
        stiffness=KP,
        damping=KD,
        saturation_effort=20.0,
        velocity_limit=30.0,
        effort_limit=12.0,
    ),
    delay_min_lag=LAG,
    delay_max_lag=LAG,
)
MIXED = (NATIVE, DELAYED, EXPLICIT)
"""Explicit, native and delayed; the rear knees keep the actuators of the file."""

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <default><joint armature="0.02"/></default>
  <worldbody>
    <geom name="table" type="plane" size="1 1 1"/>
    <body name="base" pos="0 0 0.1"><geom size="0.05" mass="1"/>
      <body name="upper" pos="0 0 0.1"><joint name="shoulder" axis="0 1 0" range="-1 2"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3" mass="0.4"/>
        <body name="lower" pos="0 0 0.3"><joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3" mass="0.3"/>
          <site name="tip" pos="0 0 0.3"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
ARM_PD = IdealPdActuatorCfg(joint_names_expr=("shoulder", "elbow"), stiffness=20.0, damping=0.5)


def write(folder: Path, text: str, name: str = "robot.xml") -> Path:
    """A file with that text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def dog(folder: Path, **options) -> MjcfWalker:
    """The dog, with the mix of actuators where nothing else is said."""
    path = write(folder, DOG, "dog.xml")
    return MjcfWalker.from_file(path, options.pop("actuators", MIXED), **options)


class Drive(composer.Task):
    """Walkers in one arena, each at its own place; an action is theirs, one after the other."""

    def __init__(self, *walkers, arena=None, timestep=0.005, substeps=4, gap=2.0):
        self.walkers = walkers
        self._arena = floors.Floor() if arena is None else arena
        for i, walker in enumerate(walkers):
            frame = self._arena.attach(walker)
            frame.pos = [gap * i, 0, 0]
            walker.create_root_joints(frame)
        self.set_timesteps(control_timestep=timestep * substeps, physics_timestep=timestep)

    @property
    def root_entity(self):
        return self._arena

    def action_spec(self, physics):
        return [walker.action_spec for walker in self.walkers]

    def before_step(self, physics, action, random_state):
        for walker, part in zip(self.walkers, action, strict=True):
            walker.apply_action(physics, part, random_state)

    def get_reward(self, physics):
        return 0.0


def without_camera(walker) -> None:
    """Leaves out what needs a renderer."""
    walker.observables.egocentric_camera.enabled = False


def go_to_target_task(walker, **_):
    """dm_control's, as it is."""
    return go_to_target.GoToTarget(walker=walker, arena=floors.Floor())


def corridor_task(walker, **_):
    """dm_control's, as it is but for the camera."""
    task = corridors.RunThroughCorridor(
        walker=walker, arena=corridor_arenas.WallsCorridor(), contact_termination=False
    )
    without_camera(walker)
    return task


def soccer_task(one, other):
    """dm_control's, as it is."""
    players = [soccer_player(team.Team.HOME, one), soccer_player(team.Team.AWAY, other)]
    return soccer.Task(players=players, arena=pitch.Pitch(size=(16, 12)))


def soccer_player(side, walker):
    """A walker of a team."""
    return team.Player(team=side, walker=walker)
