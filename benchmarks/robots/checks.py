"""What is done with a robot file: walkers, its own log, a rehearsal and its diagnosis."""

from __future__ import annotations

import json
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from dm_control import composer

from walkerkit import gap
from walkerkit.actuators import (
    ActuatorCfg,
    BuiltinDcMotorActuatorCfg,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.actuators.drive import on_joint, read_inputs
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.walkers import MjcfWalker

EFFECTS = ("coulomb_friction", "viscous_friction", "armature", "torque_constant", "command_delay")
"""Of which one is hidden, the first, and all are looked for."""
_STEPS, _SUBSTEPS = 500, 5
_SECONDS, _LEAST_RATE = 2.0, 100.0
_STILL, _SETTLED, _NOISE = 0.2, 2.0, 1e-5  # s, s, rad or m
_SIZES = {"position": 0.15, "velocity": 0.4, "effort": 0.1, "voltage": 0.1}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of one file.

    Attributes:
        file: its name.
        walkers: the configs with which it is a walker, of those tried; what refused the others.
        repeats: of these, those whose steps are the same to the last bit the second time.
        own: the verdict on its own log, or what refused it.
        found: what was named of the rehearsal, or what refused it.
        hidden: what was hidden there.
        tracebacks: what was raised that is no refusal.
    """

    file: str
    walkers: tuple[str, ...]
    tried: int
    repeats: tuple[str, ...]
    refused: tuple[str, ...]
    own: str
    found: str
    hidden: str
    tracebacks: tuple[str, ...]

    def to_json(self) -> str:
        """A line of the file of outcomes."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @classmethod
    def from_json(cls, text: str) -> Outcome:
        """What `to_json` wrote."""
        known = json.loads(text)
        return cls(**{k: tuple(v) if isinstance(v, list) else v for k, v in known.items()})


def check(name: str, path: Path, *, diagnose: bool = True) -> Outcome:
    """Does it all with one file.

    Args:
        name: what to call it.
        path: the file.
        diagnose: rehearse and diagnose as well, which takes longest.
    """
    broken: list[str] = []

    def attempt(what: Callable[[], str]) -> str:
        try:
            return what()
        except np.linalg.LinAlgError:  # a ValueError that says nothing of the robot
            broken.append(traceback.format_exc())
            return "traceback"
        except (InputError, ValueError) as error:
            return f"refused: {error}"
        except Exception:  # a robot file may raise anything, which is what is counted here
            broken.append(traceback.format_exc())
            return "traceback"

    walkers, repeats, refused, tried = [], [], [], 0
    with warnings.catch_warnings():
        # Gains that suit no integrator are a warning, and not what is looked at.
        warnings.simplefilter("ignore")
        model = mujoco.MjModel.from_xml_path(str(path))
        for config, cfg in configs(model).items():
            tried += 1
            answer = attempt(lambda cfg=cfg: _walks(path, cfg))  # type: ignore[misc]
            if answer.startswith("refused"):
                refused.append(f"{config}: {answer}")
            elif answer != "traceback":
                walkers.append(config)
                repeats += [config] if answer == "same" else []
        own = attempt(lambda: _own(path, model))
        hidden, found = EFFECTS[0], "not asked"
        if diagnose:
            found = attempt(lambda: _diagnosed(path))
    return Outcome(
        file=name,
        walkers=tuple(walkers),
        tried=tried,
        repeats=tuple(repeats),
        refused=tuple(refused),
        own=own,
        found=found,
        hidden=hidden,
        tracebacks=tuple(broken),
    )


def configs(model: mujoco.MjModel) -> dict[str, ActuatorCfg | None]:
    """Actuators to try on all joints, gentle enough for each of them; None for the file's own."""
    names = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] >= 2]
    inertia = {n: 1 / max(model.dof_invweight0[model.joint(n).dofadr[0]], 1e-6) for n in names}
    h = model.opt.timestep
    each: Mapping[str, Any] = {
        "joint_names_expr": (".*",),
        "stiffness": float(0.01 * min(inertia.values(), default=1.0) / h**2),
        "damping": float(0.1 * min(inertia.values(), default=1.0) / h),
    }
    ideal = IdealPdActuatorCfg(**each)
    motor = {"torque_constant": 0.1, "resistance": 5.0, "gear_ratio": 1.0}
    return {
        "its own": None,
        "ideal PD": ideal,
        "DC motor": DcMotorActuatorCfg(
            **each, saturation_effort=50.0, velocity_limit=40.0, effort_limit=30.0
        ),
        "delayed": DelayedActuatorCfg(base_cfg=ideal, delay_max_lag=2),
        "position": BuiltinPositionActuatorCfg(**each),
        "PD": BuiltinPdActuatorCfg(**each),
        "velocity": BuiltinVelocityActuatorCfg(joint_names_expr=(".*",), damping=each["damping"]),
        "motor": BuiltinMotorActuatorCfg(
            joint_names_expr=(".*",), effort_limit=min(0.1, each["stiffness"])
        ),
        "builtin DC motor": BuiltinDcMotorActuatorCfg(**each, **motor, input="position"),
    }


class _Alone(composer.Task):
    """A walker in an empty arena."""

    def __init__(self, walker: MjcfWalker, timestep: float):
        self._arena = composer.Arena()
        self._walker = walker
        walker.create_root_joints(self._arena.attach(walker))
        self.set_timesteps(_SUBSTEPS * timestep, timestep)

    @property
    def root_entity(self) -> composer.Arena:
        return self._arena

    def before_step(self, physics: Any, action: Any, random_state: Any) -> None:
        self._walker.apply_action(physics, action, random_state)

    def get_reward(self, physics: Any) -> float:
        return 0.0


def _walks(path: Path, cfg: ActuatorCfg | None) -> str:
    """Some steps of a walker, twice; "same" where they are so to the last bit."""
    timestep = mujoco.MjModel.from_xml_path(str(path)).opt.timestep
    ends = []
    for _ in range(2):
        walker = MjcfWalker.from_file(path, cfg)
        environment = composer.Environment(_Alone(walker, timestep), random_state=0)
        environment.reset()
        actions = np.random.RandomState(1)
        hold = walker.action_for()
        for _ in range(_STEPS // _SUBSTEPS):
            environment.step(hold + actions.uniform(-0.1, 0.1, hold.shape))
        data = environment.physics.data
        ends.append(np.concatenate([data.qpos, data.qvel, data.act]))
    return "same" if np.array_equal(*ends) else "other"


def _own(path: Path, model: mujoco.MjModel) -> str:
    """The verdict on a log that the model itself has made."""
    if not model.nu:
        raise ValueError("the file has no actuator, so nothing can be sent to it")
    recording = gap.Recording(name="own", **own_log(model))
    found = gap.compare(path, [recording], n_threads=1)
    position = found.gap.position
    return f"{found.verdict} ({position.before:.2g} {position.unit})"


def _diagnosed(path: Path) -> str:
    """What is named of an effect hidden in the file's rehearsal."""
    hidden = rehearse(path, [EFFECTS[0]], seconds=_SECONDS)
    found = gap.diagnose(path, hidden.recordings, effects=EFFECTS, n_threads=1)
    return ", ".join(named.effect for named in found.effects) or found.verdict


def own_log(model: mujoco.MjModel) -> dict[str, Any]:
    """Time and columns of a log: gentle targets of every actuator, noise of an encoder on top."""
    step = model.opt.timestep
    stride = max(int(1 / (_LEAST_RATE * step)), 1)
    rows = int(_SECONDS / (stride * step))
    time = stride * step * np.arange(rows)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    targets = dict(_targets(model, data, time, rng))
    joints = [j for j in _of_the_robot(model) if model.jnt_type[j] >= 2 and model.joint(j).name]
    base = next((j for j in range(model.njnt) if model.jnt_type[j] == 0), None)
    lead = 0 if base is not None else round(_SETTLED / step)
    for drive, values in targets.values():
        data.ctrl[drive.ctrl] = drive.control(float(values[0]))
    mujoco.mj_step(model, data, lead)
    states = np.empty((rows, model.nq + model.nv))
    for row in range(rows):
        for drive, values in targets.values():
            data.ctrl[drive.ctrl] = drive.control(float(values[row]))
        states[row] = np.concatenate([data.qpos, data.qvel])
        mujoco.mj_step(model, data, stride)
    columns = {column: values for column, (_, values) in targets.items()}
    for joint in joints:
        name, at = model.joint(joint).name, model.jnt_qposadr[joint]
        columns[f"{name}/position"] = states[:, at] + _NOISE * rng.standard_normal(rows)
    if base is not None:
        pose = states[:, model.jnt_qposadr[base] :][:, :7]
        names = [f"base/position_{x}" for x in "xyz"] + [f"base/quaternion_{x}" for x in "wxyz"]
        columns |= dict(zip(names, pose.T, strict=True))
    return {"time": time, "columns": columns}


def _of_the_robot(model: mujoco.MjModel) -> list[int]:
    """The joints of the trees that something drives or a tendon ties to them; not the scenery."""
    driven = {joint for a in range(model.nactuator) if (joint := on_joint(model, a)) is not None}
    trees = set(model.body_rootid[model.jnt_bodyid[list(driven)]]) if driven else None
    for tied in _tied(model):
        if trees and trees & tied:
            trees |= tied
    return [
        joint
        for joint in range(model.njnt)
        if trees is None or model.body_rootid[model.jnt_bodyid[joint]] in trees
    ]


def _tied(model: mujoco.MjModel) -> Iterator[set[int]]:
    """The trees that each tendon ties to each other."""
    bodies = {
        int(mujoco.mjtWrap.mjWRAP_JOINT): model.jnt_bodyid,
        int(mujoco.mjtWrap.mjWRAP_SITE): model.site_bodyid,
    }
    for first, count in zip(model.tendon_adr, model.tendon_num, strict=True):
        wraps = range(first, first + count)
        yield {
            int(model.body_rootid[bodies[model.wrap_type[w]][model.wrap_objid[w]]])
            for w in wraps
            if model.wrap_type[w] in bodies
        }


def _targets(
    model: mujoco.MjModel, data: mujoco.MjData, time: Any, rng: np.random.Generator
) -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Column, what takes it, and its values, for every actuator that takes targets."""
    known: set[str] = set()
    for actuator in range(model.nactuator):
        joint = on_joint(model, actuator)
        for drive in read_inputs(model, actuator):
            column = f"{model.actuator(actuator).name}/{drive.kind}_target"
            if joint is not None and model.joint(joint).name:
                own = f"{model.joint(joint).name}/{drive.kind}_target"
                column = column if own in known else own
            known.add(column)
            size, middle = _SIZES[drive.kind], 0.0
            if drive.kind == "position":
                length = data.actuator_length[model.actuator_outadr[actuator]]
                middle = (length - drive.offset) / drive.slope
            if model.actuator_ctrllimited[drive.ctrl]:
                low, high = model.actuator_ctrlrange[drive.ctrl]
                size = min(size, 0.1 * (high - low) / abs(drive.slope))
            wave = size * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * time + rng.uniform(0, 6))
            yield column, (drive, middle + wave * np.clip((time - _STILL) / 0.2, 0.0, 1.0))


def written_file(name: str, text: str) -> Path:
    """A robot file of a text, in a folder of its own."""
    path = Path(tempfile.mkdtemp(prefix="robot_files_")) / f"{name}.xml"
    path.write_text(text, encoding="utf-8")
    return path
