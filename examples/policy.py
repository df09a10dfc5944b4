"""Says which effect makes a quadruped fall that trots in its model.

    python examples/policy.py [OUT]

The robot differs from its model in two ways. Its targets come late, which makes half of the gap of
a log; and the drive of one calf is weak, which hardly shows in it. Logs of that leg on a bench are
diagnosed, and the trot is rolled out on the quadruped as given, mended, and with each effect.
OUT then holds the models, the diagnosis, and policy.html to look at.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "disable")

import mujoco
import numpy as np
from _arguments import argument
from dm_control import composer

from walkerkit import gap
from walkerkit.actuators import ActuatorCmd
from walkerkit.tasks import TrackJoints, TrackVelocity
from walkerkit.walkers import QUADRUPED_XML, MjcfWalker, Trot

GAINS = {"hip": (80.0, 1.5, 23.7), "thigh": (80.0, 1.5, 23.7), "calf": (120.0, 2.0, 35.5)}
"""Of the servos: N·m/rad, N·m·s/rad, and how much they make, N·m."""
WEAK, LATE = 4.0, 0.016
"""What the robot's drive of the calf makes [N·m], and how late targets come [s]."""
LEG, MOVED = "FL", ("FL_thigh", "FL_calf")
CONTROL_STEP = 0.02  # s
NOISE = {"position": 1e-3, "velocity": 0.02, "effort": 0.05}
EFFECTS = ("command_delay", "effort_limit", "coulomb_friction")


def quadruped() -> mujoco.MjSpec:
    """The model: our quadruped with position servos."""
    spec = mujoco.MjSpec.from_file(str(QUADRUPED_XML))
    for joint in (one for one in spec.joints if one.name != "root"):
        stiffness, damping, limit = GAINS[joint.name.partition("_")[2]]
        servo = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_position(kp=stiffness, kv=damping)
        servo.forcelimited, servo.forcerange = 1, [-limit, limit]
    return spec


def hidden(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """The robot: its targets come late, and one drive is weak."""
    for servo in spec.actuators:
        servo.delay, servo.interp = LATE, 1
        servo.nsample = int(np.ceil(LATE / spec.option.timestep)) + 1
    spec.actuator(f"{LEG}_calf").forcerange = [-WEAK, WEAK]
    return spec


def on_a_bench(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """One leg of it, with the trunk fixed."""
    for key in list(spec.keys):
        spec.delete(key)
    spec.delete(spec.joint("root"))
    for body in [one for one in spec.bodies if one.name.endswith("_hip")]:
        if not body.name.startswith(LEG):
            spec.delete(body)
    for servo in [one for one in spec.actuators if not one.name.startswith(LEG)]:
        spec.delete(servo)
    spec.body("trunk").pos = [0.0, 0.0, 1.0]
    return spec


def logged(model: Path, seed: int = 0) -> list[gap.Recording]:
    """Logs of the leg, as its encoders and drives would tell them."""
    random = np.random.default_rng(seed)
    found = []
    for excitation in ("steps", "chirp", "multisine"):
        walker = MjcfWalker.from_file(model, home={"FL_thigh": 0.9, "FL_calf": -1.8})
        task = TrackJoints(
            walker, excitation=excitation, seconds=2.5, max_velocity=15.0, joint_names_expr=MOVED
        )
        log = gap.record(composer.Environment(task, random_state=seed), every="physics_step")
        columns = {
            name: values + random.normal(0.0, NOISE.get(name.partition("/")[2], 0.0), len(values))
            for name, values in log.columns.items()
            if name.startswith(MOVED)
        }
        found.append(gap.Recording(name=excitation, time=log.time, columns=columns))
    return found


class TrotPolicy:
    """The trot as a policy: it looks at nothing but how long it has been trotting.

    Args:
        model: whose joints an action moves.
    """

    def __init__(self, model: Path):
        self._walker, self._gait, self._time = MjcfWalker.from_file(model), Trot(), 0.0

    def __call__(self, timestep: Any) -> Any:
        """The action for the next control step."""
        self._time = 0.0 if timestep.first() else self._time + CONTROL_STEP
        return self._walker.action_for(ActuatorCmd(position_target=self._gait(self._time)))


def make_environment(robot: Any) -> composer.Environment:
    """Five seconds of walking ahead, from a pose that is drawn."""
    task = TrackVelocity(
        robot.walker(),
        forward=(0.5, 0.7),
        left=(0.0, 0.0),
        yaw_rate=(0.0, 0.0),
        control_timestep=CONTROL_STEP,
        joint_noise=0.1,
    )
    return composer.Environment(task, time_limit=5.0)


def main(out: str | Path = "policy", episodes: int = 5) -> gap.PolicyGap:
    """Hides, logs, diagnoses and asks what of it breaks the trot."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    model, bench, robot = (folder / f"{name}.xml" for name in ("quadruped", "bench", "robot"))
    model.write_text(quadruped().to_xml())
    bench.write_text(on_a_bench(quadruped()).to_xml())
    robot.write_text(on_a_bench(hidden(quadruped())).to_xml())
    result = gap.diagnose(bench, logged(robot), effects=EFFECTS)
    result.save(folder / "diagnosis")
    left = "".join(f", {1e3 * one.gap_after:.1f} with {one.effect}" for one in result.effects)
    print(f"gap of the log: {1e3 * result.gap.position.before:.1f} mrad as given{left}\n")
    found = gap.policy_gap(
        make_environment, TrotPolicy(model), result, model=model, episodes=episodes
    )
    found.save(folder / "policy")
    print(found)
    return found


if __name__ == "__main__":
    main(argument(__doc__, "OUT", "policy"))
