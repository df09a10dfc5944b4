"""Robots that stand, as a user's file would have them."""

from __future__ import annotations

from pathlib import Path

import mujoco

from walkerkit.gap.rehearsal.standing import write_standing

_LEG = """
<body name="{side}_hip" pos="0 {y} -0.05">
  <joint name="{side}_yaw" axis="0 0 1" range="-1 1"/><joint name="{side}_roll" axis="1 0 0"
    range="-0.6 0.6"/><joint name="{side}_pitch" axis="0 1 0" range="-1.5 1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.18" size="0.03" mass="0.7"/>
  <body name="{side}_shin" pos="0 0 -0.2"><joint name="{side}_knee" axis="0 1 0" range="0 2.2"/>
    <geom type="capsule" fromto="0 0 -0.04 0 0 -0.18" size="0.025" mass="0.5"/>
    <body name="{side}_foot" pos="0 0 -0.2"><joint name="{side}_ankle" axis="0 1 0" range="-1 1"/>
      <joint name="{side}_tilt" axis="1 0 0" range="-0.5 0.5"/>
      <geom name="{side}_sole" type="box" size="0.11 0.06 0.01" pos="0.01 0 -0.03" mass="0.3"
        friction="0.9"/></body></body></body>
"""
_JOINTS = ("yaw", "roll", "pitch", "knee", "ankle", "tilt")
_POSE = (0.0, 0.0, -0.4, 0.8, -0.4, 0.0)


def write_two_legs(folder: Path, *, height: float = 0.46) -> Path:
    """A robot of two legs with large flat feet, in a keyframe with its base at some height [m]."""
    legs = "".join(_LEG.format(side=side, y=y) for side, y in (("left", 0.08), ("right", -0.08)))
    servos = "".join(
        f'<position name="{side}_{name}" joint="{side}_{name}" kp="300" kv="6" '
        'forcerange="-80 80"/>'
        for side in ("left", "right")
        for name in _JOINTS
    )
    pose = " ".join(map(str, (0, 0, height, 1, 0, 0, 0, *_POSE, *_POSE)))
    path = folder / "two_legs.xml"
    path.write_text(
        '<mujoco model="two_legs"><compiler angle="radian"/><option timestep="0.002" '
        'integrator="implicitfast"/><default><joint armature="0.01" damping="0.2"/></default>'
        '<worldbody><geom name="floor" type="plane" size="0 0 1"/><body name="trunk" pos="0 0 1">'
        '<freejoint/><geom type="box" size="0.05 0.06 0.08" pos="0 0 0.05" mass="4"/>'
        f"{legs}</body></worldbody><actuator>{servos}</actuator>"
        f'<keyframe><key name="home" qpos="{pose}"/></keyframe></mujoco>',
        encoding="utf-8",
    )
    return path


def write_four_legs(folder: Path, *, limit: float | None = None) -> Path:
    """Our quadruped on servos, with all of one effort limit where it is given [N·m]."""
    path = write_standing(folder)
    if limit is not None:
        spec = mujoco.MjSpec.from_file(str(path))
        for actuator in spec.actuators:
            actuator.forcerange = [-limit, limit]
        spec.compile()
        path.write_text(spec.to_xml(), encoding="utf-8")
    return path
