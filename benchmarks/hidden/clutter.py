"""A robot whose model is wrong everywhere, as models of real robots are.

    real, beside = clutter(rig_path, folder, rng, rate=500.0)
    run_hardware(real, targets, hidden=[*beside, hidden])

Damping, dry friction and armature of each joint are off by up to half, gains of each servo by up to
15 %, masses by up to 5 %; commands come a sample late; dry friction is that of bristles, which bend
by milliradians before they slide. Where the model has no dry friction the robot has a little.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from walkerkit.gap.rehearsal.hidden import HiddenEffect

LOSSES: Final = 0.5
"""By how much of themselves armature, damping and frictionloss of each joint may be off."""
GAINS: Final = 0.15
"""By how much of themselves kp and kv of each servo may be off."""
MASSES: Final = 0.05
"""By how much of itself each body's mass may be off; its inertia goes with it."""
BEND: Final = (0.001, 0.004)
"""How far bristles bend before they slide, rad."""
LITTLE: Final = (0.002, 0.01)
"""Dry friction where the model has none, of the drive's effort limit."""


def clutter(
    path: Path, folder: Path, rng: np.random.Generator, *, rate: float, file: str = "real.xml"
) -> tuple[Path, tuple[HiddenEffect, ...]]:
    """Makes the machine that a model is meant to be.

    Args:
        path: MJCF of the model: position servos with a limit, one on each joint.
        folder: where the machine is written.
        rng: source of what is off.
        rate: samples a second of its log.
        file: name of its file.

    Returns:
        Path of the machine's MJCF, and what else it has that the model has not.
    """
    spec = mujoco.MjSpec.from_file(str(path))

    def off(most: float) -> float:
        return 1.0 + float(rng.uniform(-most, most))

    for body in spec.bodies:
        heavier = off(MASSES)
        if body.explicitinertial:
            body.mass *= heavier
            body.inertia = heavier * np.asarray(body.inertia)
        for geom in body.geoms:
            geom.mass *= heavier  # NaN where its density says it
            geom.density *= heavier
    for servo in spec.actuators:
        kp, kv = off(GAINS), off(GAINS)
        servo.gainprm[0] *= kp
        servo.biasprm[1] *= kp
        servo.biasprm[2] *= kv
    dry: dict[str, float] = {}
    limits = {servo.target: float(servo.forcerange[1]) for servo in spec.actuators}
    for joint in spec.joints:
        joint.armature *= off(LOSSES)
        joint.damping = off(LOSSES) * np.asarray(joint.damping)
        none = float(rng.uniform(*LITTLE)) * limits[joint.name]
        dry[joint.name] = joint.frictionloss * off(LOSSES) if joint.frictionloss else none
        joint.frictionloss = 0.0
    spec.compile()
    real = folder / file
    real.write_text(spec.to_xml(), encoding="utf-8")
    return real, (
        HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 1.0 / rate}),
        HiddenEffect(
            effect="presliding_friction",
            joints=tuple(dry),
            values={
                **{f"{joint}/frictionloss": loss for joint, loss in dry.items()},
                **{f"{joint}/bend": float(rng.uniform(*BEND)) for joint in dry},
            },
        ),
    )
