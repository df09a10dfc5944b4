"""The simulated robot: a compiled model, and how a recording's signals map onto it.

robot = load_robot("leg.xml")
robot.joints                      # names of the hinge and slide joints, in kinematic order
robot.channels(recording.joints)  # checks that they exist
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import mujoco

from walkerkit.actuators.drive import Drive, TargetKind, drives_of_joint
from walkerkit.gap.errors import InputError, closest, one_line
from walkerkit.gap.recordings.manifest import is_callable

_MEND = "Mend the MJCF until MuJoCo loads it."
_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A hinge or slide joint.

    Attributes:
        name: its name in the model.
        id: joint id.
        qpos, dof: address in qpos and qvel.
        drives: its actuators.
        slide: True for a slide joint (m, N instead of rad, N·m).
    """

    name: str
    id: int
    qpos: int
    dof: int
    drives: tuple[Drive, ...]
    slide: bool

    def drive(self, kind: TargetKind) -> Drive | None:
        """The actuator that takes targets of this kind, or None."""
        return next((drive for drive in self.drives if drive.kind == kind), None)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What lies between a joint and its log and MJCF cannot say; read from `actuators.json`.

    Attributes:
        position_delay: age of the logged position and velocity [s].
        effort_scale: logged effort over the effort that reaches the joint.
        effort_offset: added to the logged effort [N·m].
    """

    position_delay: float = 0.0
    effort_scale: float = 1.0
    effort_offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Excursion:
    """How far a joint went in its recordings; effects take their typical sizes from it.

    Attributes:
        lower, upper: positions [rad, or m].
        velocity: peak speed [rad/s].
        acceleration: peak acceleration [rad/s²].
        effort: peak effort, as measured, else as commanded or as the servo would make it [N·m].
    """

    lower: float = -1.0
    upper: float = 1.0
    velocity: float = 1.0
    acceleration: float = 10.0
    effort: float = 1.0

    @property
    def range(self) -> float:
        """Width of the positions [rad]."""
        return self.upper - self.lower


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A model ready for replay.

    Attributes:
        source: what the user named: a path or `package.module:callable`.
        spec: the editable model; `model` is compiled from it.
        model: the compiled model; never written to.
        joints: joint name to joint, in kinematic order.
        measurement: joint name to what is known of its measurement; absent means ideal.
        excursions: joint name to how far it went; absent means unknown.
        hold: what its targets are between samples, where that is known already.
        laws: joint name to the drivetrain laws that it has beside the model, by name, each with its
            parameters.
    """

    source: str
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    joints: Mapping[str, Joint]
    measurement: Mapping[str, Measurement] = field(default_factory=dict)
    excursions: Mapping[str, Excursion] = field(default_factory=dict)
    hold: Literal["zero_order", "linear"] | None = None
    laws: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)

    @property
    def path(self) -> Path | None:
        """The file that the model came from, or None."""
        return None if is_callable(self.source) else Path(self.source)

    @property
    def stem(self) -> str:
        """Short name, used for the files that are written."""
        return (
            self.source.rpartition(":")[2] if is_callable(self.source) else Path(self.source).stem
        )

    def refined(self, factor: int, *, other_integrator: bool = False) -> Robot:
        """The same robot with a timestep that is `factor` times shorter.

        Args:
            factor: how many times.
            other_integrator: exchange implicit integration of the actuators' damping for explicit,
                or the other way round.
        """
        spec = self.spec.copy()
        spec.option.timestep /= factor
        if other_integrator:
            euler = spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER
            spec.option.integrator = (
                mujoco.mjtIntegrator.mjINT_IMPLICITFAST
                if euler
                else mujoco.mjtIntegrator.mjINT_EULER
            )
        for delayed in (*spec.actuators, *spec.sensors):
            delayed.nsample *= factor
        return replace(self, spec=spec, model=spec.compile())

    def measured(self, joint: str) -> Measurement:
        """What is known of a joint's measurement."""
        return self.measurement.get(joint, Measurement())

    def excursion(self, joint: str) -> Excursion:
        """How far a joint went."""
        return self.excursions.get(joint, Excursion())

    @property
    def bodies(self) -> tuple[str, ...]:
        """Named bodies that can move, in kinematic order."""
        model = self.model
        return tuple(
            model.body(body).name
            for body in range(1, model.nbody)
            if model.body_weldid[body] == body and model.body(body).name
        )

    def check_joints(self, names: Iterable[str], source: str) -> None:
        """Raises InputError where the model lacks one of `names`, which come from `source`."""
        known = ", ".join(map(repr, self.joints))
        for name in names:
            if name not in self.joints:
                raise InputError(
                    f"{source}: joint {name!r} is not in the model {self.source}"
                    f"{closest(name, self.joints) or f', which has {known}'}. "
                    f"Rename the columns `{name}/…` or the joint."
                )


def load_robot(source: str | Path) -> Robot:
    """Loads and compiles a model.

    Args:
        source: path of an MJCF (or URDF) file, or `package.module:callable`, a function without
            arguments that returns a walker, a PyMJCF element, an MjSpec or MJCF text.

    Returns:
        The robot.

    Raises:
        InputError: the file is missing or does not compile, or the robot has no joint to compare.
    """
    name = str(source)
    spec = _spec_from_callable(name) if is_callable(name) else _spec_from_file(Path(source))
    return robot_from_spec(spec, name)


def robot_from_spec(spec: mujoco.MjSpec, source: str) -> Robot:
    """Compiles `spec`; `source` names it in messages.

    Raises:
        InputError: it does not compile, its base floats, or it has no named hinge or slide joint.
    """
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"{source}: the model does not compile: {one_line(error)}. {_MEND}"
        ) from None
    floating = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    if floating:
        base = model.body(model.jnt_bodyid[floating[0]]).name
        raise InputError(
            f"{source}: body {base!r} has a free joint; logs of a floating base are not supported "
            "yet. Hang the robot up for the recording and remove the free joint."
        )
    joints = {
        model.joint(j).name: _joint(model, j)
        for j in range(model.njnt)
        if model.jnt_type[j] in _SCALAR_JOINTS and model.joint(j).name
    }
    if not joints:
        raise InputError(f"{source}: the model has no named hinge or slide joint. Name its joints.")
    return Robot(source=source, spec=spec, model=model, joints=joints)


def _spec_from_file(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise InputError(
            f"{path}: no such model file. Give an MJCF file or `package.module:callable`."
        )
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"{path}: the model does not compile: {one_line(error)}. {_MEND}"
        ) from None


def _spec_from_callable(source: str) -> mujoco.MjSpec:
    module_name, _, function_name = source.rpartition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a module can fail to import in any way
        raise InputError(
            f"{source}: cannot import {module_name!r}: {one_line(error)}. "
            "Install it or run from its folder."
        ) from error
    make = getattr(module, function_name, None)
    if not callable(make):
        raise InputError(
            f"{source}: {module_name!r} has no function {function_name!r}"
            f"{closest(function_name, vars(module))}. Name one that returns the walker."
        )
    try:
        return _spec_of(make(), source)
    except InputError:
        raise
    except Exception as error:  # it is the user's function
        raise InputError(
            f"{source}: it raised {type(error).__name__}: {one_line(error)}. "
            "Mend it until it returns the walker without arguments."
        ) from error


def _spec_of(made: Any, source: str) -> mujoco.MjSpec:
    if isinstance(made, mujoco.MjSpec):
        return made
    if isinstance(made, str):
        return mujoco.MjSpec.from_string(made)
    root = getattr(made, "mjcf_model", made)
    if not hasattr(root, "to_xml_string"):
        raise InputError(
            f"{source}: returned a {type(made).__name__}. "
            "Return a walker, a PyMJCF element, an MjSpec or MJCF text."
        )
    return mujoco.MjSpec.from_string(_plain_names(root.to_xml_string()), assets=root.get_assets())


def _plain_names(text: str) -> str:
    """PyMJCF's text without the names that it makes up and refuses to read again."""
    root = ElementTree.fromstring(text)
    for element in root.iter():
        for key, value in element.attrib.items():
            if value == "/":
                element.set(key, "pymjcf")
            elif value.startswith("//unnamed_"):
                element.set(key, value.removeprefix("//"))
    return ElementTree.tostring(root, encoding="unicode")


def _joint(model: mujoco.MjModel, joint: int) -> Joint:
    name = model.joint(joint).name
    return Joint(
        name=name,
        id=joint,
        qpos=int(model.jnt_qposadr[joint]),
        dof=int(model.jnt_dofadr[joint]),
        drives=drives_of_joint(model, joint),
        slide=bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE),
    )
