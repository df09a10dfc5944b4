"""Adding the named effects to the model, in MJCF where it can say them.

    mended = mend(structure.trials(robot, values[None]))   # a Robot with its spec changed
    write_model(mended, folder / "model.xml")              # and its assets beside it

What MJCF cannot say (how targets enter scaled actuators, what the log shows of position and
effort) goes to `actuators.json`; see `walkerkit.gap.simulation.sidecar`.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import CommandDelay, law_named
from walkerkit.gap.simulation.interpolate import made_delay
from walkerkit.gap.simulation.rebuild import rebuilds, rebuilt_as
from walkerkit.gap.simulation.robot import Joint, Measurement, Robot
from walkerkit.gap.simulation.trials import Trials, model_field
from walkerkit.walkers.settling import state_inertia
from walkerkit.walkers.xml_digits import xml_digits

Field = NDArray[Any]
Writer = Callable[[mujoco.MjSpec, Robot, Field, Field], None]  # spec, robot, before, wanted
SetJoint = Callable[[Any, Any, float], None]  # joint element, value, unit of its angles

_LINEAR = 1  # interpolation of an actuator's delay
_TOLERANCE = 1e-9
_ASSETS = "assets"
_DIGITS = 8  # more would show that colours are single precision


def mend(trial: Trials) -> Robot:
    """The robot with a variant's changes written into its spec.

    Args:
        trial: one variant of the robot as it was given.

    Returns:
        A robot whose compiled model has the changes; targets keep the meaning they had.

    Raises:
        ValueError: there are several variants.
        RuntimeError: the model's own settings (such as a compiler option that recomputes masses)
            keep a change from taking effect.
    """
    if trial.n != 1:
        raise ValueError(f"{trial.n} variants make {trial.n} models; mend them one by one.")
    ((rebuild, _),) = rebuilds(trial)
    if rebuild.needed:
        trial = rebuilt_as(rebuild, trial.robot).trials(trial)
    robot = trial.robot
    spec = robot.spec.copy()
    spec.compile()  # gives the elements of the copy the ids of the compiled model
    for name, wanted in trial.fields.items():
        _WRITERS[name](spec, robot, model_field(robot.model, name), wanted[0])
    laws = _laws(trial)
    joints = {
        name: _later(joint, float(trial.command_delay[name][0]), spec.option.timestep)
        for name, joint in robot.joints.items()
    }
    for name, joint in robot.joints.items():
        _delay_commands(spec, joint, float(trial.command_delay[name][0]), laws.get(name, {}))
    model = spec.compile()
    for name, wanted in trial.fields.items():
        if not np.allclose(model_field(model, name), wanted[0], rtol=_TOLERANCE, atol=_TOLERANCE):
            raise RuntimeError(
                f"{robot.source}: the model's settings keep `{name}` from being changed; "
                "look for boundmass, boundinertia or balanceinertia in its compiler element"
            )
    return replace(
        robot,
        spec=spec,
        model=model,
        # Targets enter by the law of the model as it was given: a gain that is off by ten per cent
        # is in the drive, not in the meaning of the command.
        joints=joints,
        measurement=_measurement(trial),
        laws=laws,
        programs=tuple(
            program.with_numbers({key: float(v[0]) for key, v in trial.numbers.items()})
            for program in robot.programs
        ),
    )


def _laws(trial: Trials) -> dict[str, dict[str, dict[str, float]]]:
    """The drivetrain laws of the variant that do anything, by joint and by name."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for law, joint in dict.fromkeys((law, joint) for law, joint, _ in trial.laws):
        parameters = {name: float(v[0]) for name, v in trial.law(law, joint).items()}
        if any(parameters[name] != law.neutral[name] for name in [*parameters][: law.sizes]):
            found.setdefault(joint, {})[law.name] = parameters
    return found


def write_model(robot: Robot, path: Path, taken: dict[str, Path | str] | None = None) -> None:
    """Writes the robot's MJCF, and its mesh, texture and height field files beside it.

    Args:
        robot: the robot.
        path: the file; assets go to `assets/` in its folder.
        taken: names of assets that other models have put there; added to.
    """
    taken = {} if taken is None else taken
    spec = robot.spec.copy()
    pictures, shapes = spec.textures, [*spec.meshes, *spec.hfields, *spec.skins]
    folders = [(pictures, spec.texturedir), (shapes, spec.meshdir)]
    for elements, folder in folders:
        for element in elements:
            if element.file:
                element.file = _copy_asset(robot, element.file, folder, path.parent, taken)
    for texture in pictures:
        texture.cubefiles = [
            file and _copy_asset(robot, file, spec.texturedir, path.parent, taken)
            for file in texture.cubefiles
        ]
    if taken:
        spec.meshdir = spec.texturedir = _ASSETS
        # MuJoCo reads the files once more as it writes.
        spec.modelfiledir = str(path.parent)
    with xml_digits(_DIGITS):
        text = spec.to_xml()
    path.write_text(text, encoding="utf-8")


def _copy_asset(
    robot: Robot, file: str, folder: str, target: Path, taken: dict[str, Path | str]
) -> str:
    """Copies one asset and returns the name it has there, unique among `taken`."""
    spec = robot.spec
    packed = next((key for key in (file, f"{folder}/{file}") if key in spec.assets), None)
    source: Path | str = packed or (Path(spec.modelfiledir) / folder / file).resolve()
    name, number = Path(file).name, 1
    while taken.get(name, source) != source:
        number += 1
        name = f"{Path(file).stem}_{number}{Path(file).suffix}"
    if name not in taken:
        taken[name] = source
        (target / _ASSETS).mkdir(exist_ok=True)
        if packed is not None:
            (target / _ASSETS / name).write_bytes(spec.assets[packed])
        else:
            shutil.copyfile(source, target / _ASSETS / name)
    return name


def _measurement(trials: Trials) -> dict[str, Measurement]:
    found = {}
    for name in trials.robot.joints:
        amplitude, periods, phase = map(float, trials.position_error[name][0])
        found[name] = Measurement(
            position_delay=float(trials.position_delay[name][0]),
            effort_scale=float(trials.effort_scale[name][0]),
            effort_offset=float(trials.effort_offset[name][0]),
            encoder_gain=float(trials.encoder_gain[name][0]),
            error_amplitude=amplitude,
            error_periods=periods,
            error_phase=phase,
            clock_skew=float(trials.clock_skew[name][0]),
            load_side=float(trials.load_side[name][0]),
        )
    return found


def _delay_commands(
    spec: mujoco.MjSpec, joint: Joint, delay: float, laws: dict[str, dict[str, float]]
) -> None:
    """Writes the delay of a joint's commands as MJCF has it, or among its laws.

    There it is with the model's own where one of the laws is the controller's, which sees what has
    arrived.
    """
    step = spec.option.timestep
    controlled = any(law_named(law).stage == "controller" for law in laws)
    for drive in joint.drives:
        if drive.in_python:
            continue
        actuator = _by_id(spec.actuators, drive.actuator)
        whole = float(made_delay(actuator.delay, step)) + delay
        if controlled and drive.kind == "position":
            if whole:
                known = laws.setdefault(CommandDelay.name, dict(CommandDelay.neutral))
                known["delay"] += whole
            actuator.delay, actuator.nsample = 0.0, 0
            continue
        if not delay:
            continue
        if whole < step:  # no such delay can be made; the nearest that can
            whole = step * round(whole / step)
        actuator.delay = whole
        # One sample more than the delay spans, to interpolate between.
        actuator.nsample = int(np.ceil(whole / step - 1e-9)) + 1 if whole else 0
        actuator.interp = _LINEAR


def _later(joint: Joint, delay: float, step: float) -> Joint:
    """A joint whose law in Python gets targets later, by whole steps as a walker delays them."""
    if not joint.in_python or not delay:
        return joint
    drives, inputs = (
        tuple(replace(d, late=max(0.0, step * round((d.late + delay) / step))) for d in some)
        for some in (joint.drives, joint.inputs)
    )
    return replace(joint, drives=drives, inputs=inputs)


def _by_id(elements: Any, number: int) -> Any:
    return next(element for element in elements if element.id == number)


def _joint_writer(write: SetJoint, index: Callable[[Joint], int]) -> Writer:
    """Writes what changed of a joint; `write` gets the unit of the spec's angles in radians."""

    def writer(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
        for joint in robot.joints.values():
            value = wanted[index(joint)]
            if not np.array_equal(value, before[index(joint)]):
                in_degrees = bool(spec.compiler.degree) and not joint.slide
                write(_by_id(spec.joints, joint.id), value, np.pi / 180 if in_degrees else 1.0)

    return writer


def _set(name: str) -> SetJoint:
    return lambda element, value, angle: setattr(element, name, value)


def _set_angle(name: str) -> SetJoint:
    return lambda element, value, angle: setattr(element, name, value / angle)


def _set_limited(element: Any, value: float, angle: float) -> None:
    element.limited = int(value)


def _set_first(name: str) -> SetJoint:
    """Of a polynomial's coefficients the first."""

    def write(element: Any, value: float, angle: float) -> None:
        getattr(element, name)[0] = value

    return write


def _actuator_writer(name: str) -> Writer:
    def writer(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
        for actuator in np.flatnonzero((wanted != before).reshape(len(wanted), -1).any(axis=1)):
            element = _by_id(spec.actuators, int(actuator))
            if name == "biastype":
                element.biastype = mujoco.mjtBias(int(wanted[actuator]))
            elif name == "forcelimited":
                element.forcelimited = int(wanted[actuator])
            else:
                getattr(element, name)[: wanted.shape[1]] = wanted[actuator]

    return writer


def _inertial_writer(name: str) -> Writer:
    def writer(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
        _state_inertias(spec, robot)
        for body in np.flatnonzero((wanted != before).reshape(len(wanted), -1).any(axis=1)):
            element = _by_id(spec.bodies, int(body))
            if not element.explicitinertial:
                state_inertia(element, robot.model)
            setattr(element, name, wanted[body])

    return writer


def _state_inertias(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Has all bodies say what they have come to, where the compiler would undo a change."""
    compiler = spec.compiler
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if compiler.inertiafromgeom == always or compiler.settotalmass > 0:
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        compiler.settotalmass = -1
        for body in np.flatnonzero(robot.model.body_mass):
            state_inertia(_by_id(spec.bodies, int(body)), robot.model)


def _contact_writer(elements: str, name: str) -> Writer:
    """Writes what changed of geoms or of contact pairs."""

    def writer(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
        for number in np.flatnonzero((wanted != before).any(axis=1)):
            setattr(_by_id(getattr(spec, elements), int(number)), name, wanted[number])

    return writer


def _write_places(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
    """Moves geoms, and no mass with them."""
    for number in np.flatnonzero((wanted != before).any(axis=1)):
        body = _by_id(spec.bodies, int(robot.model.geom_bodyid[number]))
        _state_inertias(spec, robot)
        if not body.explicitinertial:
            state_inertia(body, robot.model)
        geom, shift = _by_id(spec.geoms, int(number)), wanted[number] - before[number]
        if np.isfinite(geom.fromto).all():
            geom.fromto = geom.fromto + np.tile(shift, 2)
        else:
            geom.pos = geom.pos + shift


def _left_to_the_compiler(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
    """What the compiler finds by itself."""


def _write_gravity(spec: mujoco.MjSpec, robot: Robot, before: Field, wanted: Field) -> None:
    spec.option.gravity = wanted


def _write_polynomial(element: Any, value: Field, angle: float) -> None:
    element.damping[1:] = value


_WRITERS: Mapping[str, Writer] = {
    "dof_dampingpoly": _joint_writer(_write_polynomial, lambda joint: joint.dof),
    "dof_damping": _joint_writer(_set_first("damping"), lambda joint: joint.dof),
    "dof_frictionloss": _joint_writer(_set("frictionloss"), lambda joint: joint.dof),
    "dof_armature": _joint_writer(_set("armature"), lambda joint: joint.dof),
    "dof_solref": _joint_writer(_set("solref_friction"), lambda joint: joint.dof),
    "dof_solimp": _joint_writer(_set("solimp_friction"), lambda joint: joint.dof),
    "jnt_stiffness": _joint_writer(_set_first("stiffness"), lambda joint: joint.id),
    "jnt_limited": _joint_writer(_set_limited, lambda joint: joint.id),
    "jnt_range": _joint_writer(_set_angle("range"), lambda joint: joint.id),
    "jnt_solref": _joint_writer(_set("solref_limit"), lambda joint: joint.id),
    "jnt_solimp": _joint_writer(_set("solimp_limit"), lambda joint: joint.id),
    "qpos0": _joint_writer(_set_angle("ref"), lambda joint: joint.qpos),
    "qpos_spring": _joint_writer(_set_angle("springref"), lambda joint: joint.qpos),
    "body_mass": _inertial_writer("mass"),
    "body_ipos": _inertial_writer("ipos"),
    "geom_pos": _write_places,
    "geom_sameframe": _left_to_the_compiler,
    "opt.gravity": _write_gravity,
    **{
        f"{element}_{name}": _contact_writer(f"{element}s", name)
        for element in ("geom", "pair")
        for name in ("friction", "solref", "solimp")
    },
    **{
        f"actuator_{name}": _actuator_writer(name)
        for name in ("gainprm", "biasprm", "biastype", "forcerange", "forcelimited")
    },
}

FIELDS: tuple[str, ...] = tuple(_WRITERS)
"""The fields of a model, and of its options, that can be mended."""
