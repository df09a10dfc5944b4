"""A quadruped that stands on the ground and shifts: what a robot on its feet can be asked to do.

    path = write_standing("out")                      # MJCF: servos, level floor
    targets = standing_targets(rng, seconds=8.0)      # name to (T, 12) position targets, 500 Hz
    logs = run_hardware(path, list(targets.values()), names=list(targets), hidden=..., seed=0)

Three experiments, in which the trunk moves and the feet mean to stay: `sway` leans and turns it,
`squat` lowers, rolls and pitches it faster, and `steps` puts one foot after the other somewhere
else, by lifting it or by dragging it over the ground until it slips. Amplitudes and phases are
drawn; feet never leave what the legs can reach, and three of them always stay down.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.walkers.quadruped import LEGS, QUADRUPED_XML

FloatArray = NDArray[np.float64]

STANDING_EXPERIMENTS: Final = ("sway", "squat", "steps")
RATE: Final = 500.0
"""Samples a second."""

_HIP_GAIN, _CALF_GAIN = (64.0, 1.0), (143.0, 2.3)  # N·m/rad and N·m·s/rad, as `QUADRUPED_DRIVES`
_HIP_LIMIT, _CALF_LIMIT = 23.7, 35.55  # N·m
_FRONT, _SIDE, _OFFSET, _LINK = 0.18, 0.05, 0.08, 0.21  # m: hips from the trunk, thigh, links
_HOME = (0.0, 0.9, -1.8)
_BLEND = 0.8  # s, from home to the motion and back


def write_standing(folder: str | Path) -> Path:
    """Writes the quadruped with position servos, on a level floor.

    Args:
        folder: where; made if it is missing.

    Returns:
        Path of the file.
    """
    spec = mujoco.MjSpec.from_file(str(QUADRUPED_XML))
    # MuJoCo's feet creep under a sideways load, by millimetres a second, unless told not to, and
    # sink in by millimetres.
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.noslip_iterations = 5
    for leg in LEGS:
        spec.geom(f"{leg}_foot").solimp[:2] = 0.99
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        calf = joint.name.endswith("_calf")
        gain, damping = _CALF_GAIN if calf else _HIP_GAIN
        limit = _CALF_LIMIT if calf else _HIP_LIMIT
        servo = spec.add_actuator(name=joint.name, target=joint.name)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=gain, kv=damping)
        servo.forcelimited = True
        servo.forcerange = [-limit, limit]
    spec.compile()
    path = Path(folder) / "quadruped_standing.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(spec.to_xml(), encoding="utf-8")
    return path


def standing_targets(rng: np.random.Generator, *, seconds: float = 8.0) -> dict[str, FloatArray]:
    """Position targets of the three experiments.

    Args:
        rng: source of amplitudes, frequencies and phases.
        seconds: length of each experiment.

    Returns:
        Experiment to (T, 12) targets in the order of the joints [rad].
    """
    time = np.arange(0.0, seconds, 1 / RATE)
    still = np.zeros((len(time), 3))
    feet = np.broadcast_to(_home_feet(), (len(time), 4, 3))
    # Largest shift along x, y, z [m] and turn about x, y, z [rad]; how fast [Hz].
    sway = _wander(rng, time, (0.035, 0.03, 0.01, 0.06, 0.05, 0.14), (0.25, 0.9))
    squat = _wander(rng, time, (0.01, 0.008, 0.04, 0.06, 0.09, 0.03), (0.6, 1.8))
    lean, walked = _steps(rng, time)
    return {
        "sway": _legs(*sway, feet),
        "squat": _legs(*squat, feet),
        "steps": _legs(lean, still, walked),
    }


def _wander(
    rng: np.random.Generator,
    time: FloatArray,
    largest: tuple[float, ...],
    frequencies: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Shift [m] and turn [rad] of the trunk, (T, 3) each, of three sines an axis."""
    moved = np.zeros((len(time), len(largest)))
    for k, size in enumerate(largest):
        for share in (0.5, 0.3, 0.2):
            frequency, phase = rng.uniform(*frequencies), rng.uniform(0, 2 * np.pi)
            moved[:, k] += share * size * np.sin(2 * np.pi * frequency * time + phase)
    moved *= _ends(time)[:, None]
    return moved[:, :3], moved[:, 3:]


def _steps(rng: np.random.Generator, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shift of the trunk (T, 3) and the feet (T, 4, 3) of lifted and of dragged steps [m]."""
    home = _home_feet()
    lean = np.zeros((len(time), 3))
    feet = np.tile(home, (len(time), 1, 1))
    one = 1.0  # s, for each step
    order = np.concatenate([rng.permutation(4) for _ in range(int(time[-1] / one) // 4 + 1)])
    begin = 0.3
    for number, foot in enumerate(order):
        phase = (time - begin - number * one) / one
        if begin + (number + 1) * one > time[-1]:
            break
        swing = np.clip((phase - 0.35) / 0.3, 0, 1)
        moved = rng.uniform(-0.03, 0.03, 2)
        back = -(feet[-1, foot, :2] - home[foot, :2])  # so that feet do not wander off
        goal = 0.7 * back + moved
        feet[:, foot, :2] += goal * _smooth(swing)[:, None]
        dragged = number % 2 == 1
        if dragged:
            # Out and back over the ground, further than friction lets it.
            feet[:, foot, 1] += 0.06 * np.sign(home[foot, 1]) * np.sin(np.pi * swing) ** 2
        else:
            feet[:, foot, 2] += 0.04 * np.sin(np.pi * swing) ** 2
            # Over the other three, ahead of the lift and back after it.
            away = np.clip(phase / 0.3, 0, 1), np.clip((phase - 0.7) / 0.3, 0, 1)
            lean[:, :2] -= 0.25 * home[foot, :2] * (_smooth(away[0]) - _smooth(away[1]))[:, None]
    return lean, feet


def _smooth(part: FloatArray) -> FloatArray:
    """From 0 to 1 without a jump in speed or acceleration."""
    smooth: FloatArray = part**3 * (10 - 15 * part + 6 * part**2)
    return smooth


def _ends(time: FloatArray) -> FloatArray:
    """0 at both ends, 1 in between."""
    up, down = (_smooth(np.clip(t / _BLEND, 0, 1)) for t in (time, time[-1] - time))
    ends: FloatArray = up * down
    return ends


def _hips() -> FloatArray:
    """(4, 3) where the legs begin, in the trunk's frame [m]."""
    signs = [(1 if leg[0] == "F" else -1, 1 if leg[1] == "L" else -1) for leg in LEGS]
    return np.array([(_FRONT * front, _SIDE * left, 0.0) for front, left in signs])


def _home_feet() -> FloatArray:
    """(4, 3) feet in the trunk's frame at home [m]."""
    _, thigh, calf = _HOME
    x = -_LINK * (np.sin(thigh) + np.sin(thigh + calf))
    z = -_LINK * (np.cos(thigh) + np.cos(thigh + calf))
    hips = _hips()
    feet: FloatArray = hips + np.stack(
        [np.full(4, x), _OFFSET * np.sign(hips[:, 1]), np.full(4, z)], axis=1
    )
    return feet


def _legs(shift: FloatArray, turn: FloatArray, feet: FloatArray) -> FloatArray:
    """Joint angles that put the feet where they are wanted.

    Args:
        shift: (T, 3) of the trunk from home [m].
        turn: (T, 3) roll, pitch and yaw of the trunk [rad].
        feet: (T, 4, 3) in the frame of the trunk at home [m].

    Returns:
        (T, 12) rad.
    """
    roll, pitch, yaw = turn.T
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    to_world = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    seen = np.einsum("ijt,tki->tkj", to_world, feet - shift[:, None])
    hips = _hips()
    x, y, z = np.moveaxis(seen - hips, -1, 0)
    side = _OFFSET * np.sign(hips[:, 1])
    # The leg's plane is `side` away from the hip's axis.
    depth = np.sqrt(np.maximum(y**2 + z**2 - side**2, 1e-6))
    hip = np.arctan2(y, -z) - np.arctan2(side, depth)
    reach = np.clip(np.hypot(x, depth) / (2 * _LINK), 0.3, 0.995)
    calf = -2 * np.arccos(reach)
    thigh = np.arctan2(-x, depth) - 0.5 * calf
    return np.stack([hip, thigh, calf], axis=-1).reshape(len(shift), 12)
