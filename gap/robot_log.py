"""What a simulated robot can log: which columns there are, and where each is read."""

from __future__ import annotations

from typing import Any, Literal

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.locomotion.walkers import base
from numpy.typing import NDArray

from walkerkit.actuators import ActuatorCmd
from walkerkit.actuators.drive import Drive, on_joint, read_inputs
from walkerkit.actuators.messages import listed
from walkerkit.actuators.targeted import element_ids
from walkerkit.gap.recordings.recording import TARGETS
from walkerkit.gap.simulated_unit import Unit
from walkerkit.tasks.suite_physics import ActuatedPhysics
from walkerkit.walkers.actuated import Actuated
from walkerkit.walkers.drivetrain import Drivetrain

FloatArray = NDArray[np.float64]

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_BASE_POSITION = tuple(f"base/position_{axis}" for axis in "xyz") + tuple(
    f"base/quaternion_{axis}" for axis in "wxyz"
)
_BASE_VELOCITY = tuple(
    f"base/{quantity}_velocity_{axis}" for quantity in ("linear", "angular") for axis in "xyz"
)


BaseLog = Literal["pose", "imu", "both"]


class RobotLog:
    """Reads the joints of one robot before and after physics steps.

    Args:
        environment: a composer or suite environment that was just reset.
        walker: the walker to log; None where there is one alone.
        base: what is logged of a base that floats: its `pose`; what an `imu` reads and which feet
            touch the ground; or `both`.

    Attributes:
        drivetrain: of the robot, None where its actuators are MuJoCo's and not of ours.

    Raises:
        ValueError: there are several walkers, or none, or the task does not give it its actions.
    """

    def __init__(self, environment: Any, walker: Any = None, base: BaseLog = "pose"):
        physics = environment.physics
        self._model: mujoco.MjModel = physics.model.ptr
        self._data: mujoco.MjData = physics.data.ptr
        self.drivetrain: Drivetrain | None
        if isinstance(environment, composer.Environment):
            walker = _only_walker(environment) if walker is None else walker
            self.drivetrain = walker.drivetrain if isinstance(walker, Actuated) else None
            if self.drivetrain is not None:
                _refuse_bypass(environment.task)
            joints, free = _joints_of_walker(physics, walker)
            self._prefix = str(walker.mjcf_model.full_identifier)
        else:
            self._prefix = ""
            self.drivetrain = physics.drivetrain if isinstance(physics, ActuatedPhysics) else None
            joints, free = _joints_of_model(self._model)
        self._names = {id_: name for id_, name in joints.items() if self._is_scalar(id_)}
        ids = list(self._names)
        self._qpos_at, self._dof_at = self._model.jnt_qposadr[ids], self._model.jnt_dofadr[ids]
        self._base = None if free is None else self._base_at(free)
        self._logs = base
        self._unit = None
        if free is not None and base != "pose":
            self._unit = Unit(self._model, free)
        self._changes: list[FloatArray] = []
        # Column to the target's name and its place in the command, or to the drive that tells it.
        self._commanded: dict[str, tuple[str, int]] = {}
        self._controlled: dict[str, Drive] = {}
        self._driven: set[int] = set()
        self._drive_dofs: list[int] = []
        self._drive_places: list[int] = []
        self._notes: list[str] = []
        ours = [] if self.drivetrain is None else self._find_commands(self.drivetrain)
        self._find_controls(ours)
        self._states: list[FloatArray] = []
        self._efforts: list[FloatArray] = []
        self._targets: dict[str, list[float]] = {}

    def before_step(self) -> None:
        """A physics step is about to begin: state and targets."""
        data = self._data
        self._states.append(np.concatenate([data.qpos, data.qvel]))
        cmd = ActuatorCmd() if self.drivetrain is None else self.drivetrain.command
        for column, (target, place) in self._commanded.items():
            values = getattr(cmd, target)
            if values is not None:
                self._targets.setdefault(column, []).append(float(values[place]))
        for column, drive in self._controlled.items():
            target = (data.ctrl[drive.ctrl] - drive.offset) / drive.slope
            self._targets.setdefault(column, []).append(float(target))

    def after_step(self) -> None:
        """It has been made: the effort of its beginning is what MuJoCo has left."""
        effort = np.array(self._data.qfrc_actuator)
        if self.drivetrain is not None:
            effort[self._drive_dofs] += self.drivetrain.changed_effort[self._drive_places]
        self._efforts.append(effort)
        if self._unit is not None:
            before = self._states[-1][self._model.nq :]
            self._changes.append((self._data.qvel - before) / self._model.opt.timestep)

    def columns(self) -> dict[str, FloatArray]:
        """The log: column to samples."""
        rows = len(self._states)
        states = np.array(self._states).reshape(rows, self._model.nq + self._model.nv)
        qpos, qvel = np.split(states, [self._model.nq], axis=1)
        efforts = np.array(self._efforts).reshape(rows, self._model.nv)
        # A target that began in the middle of an episode was not asked for before.
        sent = {name: np.pad(v, (rows - len(v), 0)) for name, v in self._targets.items()}
        columns: dict[str, FloatArray] = {}
        if self._unit is not None:
            changes = np.array(self._changes).reshape(rows, self._model.nv)
            columns.update(self._unit.columns(qpos, qvel, changes))
        if self._base is not None and self._logs != "imu":
            columns.update(zip(_BASE_POSITION, qpos[:, self._base[0]].T, strict=True))
            columns.update(zip(_BASE_VELOCITY, qvel[:, self._base[1]].T, strict=True))
        for id_, at, dof in zip(self._names, self._qpos_at, self._dof_at, strict=True):
            name = self._names[id_]
            columns[f"{name}/position"] = qpos[:, at]
            columns[f"{name}/velocity"] = qvel[:, dof]
            if id_ in self._driven:
                columns[f"{name}/effort"] = efforts[:, dof]
            columns.update(
                (column, sent[column])
                for target in TARGETS
                if (column := f"{name}/{target}") in sent
            )
        return columns | {name: values for name, values in sent.items() if name not in columns}

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user of the log should know."""
        return tuple(self._notes)

    def _is_scalar(self, joint: int) -> bool:
        return int(self._model.jnt_type[joint]) in _SCALAR

    def _base_at(self, free: int) -> tuple[slice, slice]:
        qpos, dof = int(self._model.jnt_qposadr[free]), int(self._model.jnt_dofadr[free])
        return slice(qpos, qpos + len(_BASE_POSITION)), slice(dof, dof + len(_BASE_VELOCITY))

    def _find_commands(self, drivetrain: Drivetrain) -> list[int]:
        """Where the actuators of ours get their targets; returns MuJoCo's ids of them."""
        group = drivetrain.group
        place = {id(element): i for i, element in enumerate(group.elements)}
        for actuator, cfg in zip(group.actuators, group.cfgs, strict=True):
            if getattr(getattr(cfg, "base_cfg", cfg), "transmission", "joint") != "joint":
                # No joint's own, so that its log goes by the actuator's name.
                for element in actuator.elements:
                    for target in actuator.takes:
                        self._commanded[f"{element.name}/{target}"] = target, place[id(element)]
                continue
            for element, joint in zip(actuator.elements, actuator.joint_ids, strict=True):
                self._driven.add(int(joint))
                self._drive_dofs.append(int(self._model.jnt_dofadr[joint]))
                self._drive_places.append(place[id(element)])
                for target in actuator.takes:
                    column = f"{self._names[int(joint)]}/{target}"
                    self._commanded[column] = target, place[id(element)]
        elements = (*group.elements, *group.beside)
        if not elements:
            return []
        root = elements[0].root
        ids = element_ids(self._model, elements, mujoco.mjtObj.mjOBJ_ACTUATOR, root)
        return [int(a) for a in ids]

    def _find_controls(self, ours: list[int]) -> None:
        """Where the targets of MuJoCo's other actuators can be read from their controls."""
        model = self._model
        for actuator in range(model.nactuator):
            name = model.actuator(actuator).name
            joint = on_joint(model, actuator)
            if actuator in ours or not name.startswith(self._prefix):
                continue
            if joint is not None and joint in self._names:
                self._driven.add(joint)
            for drive in read_inputs(model, actuator):
                column = f"{name.removeprefix(self._prefix)}/{drive.kind}_target"
                if joint is not None and joint in self._names:
                    own = f"{self._names[joint]}/{drive.kind}_target"
                    column = column if own in self._controlled else own
                self._controlled[column] = drive


def _only_walker(environment: composer.Environment) -> Any:
    entities = environment.task.root_entity.iter_entities()
    walkers = [entity for entity in entities if isinstance(entity, base.Walker)]
    if len(walkers) != 1:
        names = [str(walker.mjcf_model.model) for walker in walkers]
        raise ValueError(
            f"the environment has {len(walkers)} walkers, {listed(names)}: say with walker=... "
            "whose joints to log"
        )
    return walkers[0]


def _refuse_bypass(task: composer.Task) -> None:
    """Refuses tasks whose actions go to MuJoCo's controls, where no walker sees them."""
    if type(task).before_step is composer.Task.before_step:
        raise ValueError(
            f"{type(task).__name__} writes actions into MuJoCo's controls, past the walker and its "
            "actuators: use a task that calls walker.apply_action, such as TrackJoints"
        )


def _joints_of_walker(physics: Any, walker: Any) -> tuple[dict[int, str], int | None]:
    """Ids and names of its named joints, in kinematic order, and its free joint if it has one."""
    root = walker.mjcf_model
    named = [joint for joint in root.find_all("joint") if joint.name]
    joints = {
        int(physics.bind(joint).element_id): str(joint.prefixed_identifier(root.namescope))
        for joint in named
    }
    free = mjcf.get_frame_freejoint(root) if root.parent_model is not None else None
    ids = dict(sorted(joints.items()))
    return ids, None if free is None else int(physics.bind(free).element_id)


def _joints_of_model(model: mujoco.MjModel) -> tuple[dict[int, str], int | None]:
    joints = {i: model.joint(i).name for i in range(model.njnt) if model.joint(i).name}
    free = np.flatnonzero(model.jnt_type == _FREE)
    return joints, int(free[0]) if len(free) else None
