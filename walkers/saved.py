"""What `actuators.json` says of a robot that the gap workflow has mended, for its walker.

    saved = saved_actuators("out/model.xml")
    walker = MjcfWalker.from_file("out/model.xml", saved.actuators, laws=saved.laws)

`MjcfWalker.from_file("out/model.xml")` alone does the same. The file lies beside the model; without
one the robot's own actuators are taken over as the XML has them. What lies between a joint and its
log (`measurement`) belongs to a replay and not to a walker, which has no log.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from walkerkit.actuators import (
    ActuatorCfg,
    DelayedActuatorCfg,
    LearnedMlpActuatorCfg,
    XmlInputsActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)
from walkerkit.actuators.drive import on_joint, read_inputs
from walkerkit.actuators.drivetrain import LAWS, DrivetrainLaw
from walkerkit.actuators.errors import closest, listed
from walkerkit.actuators.inputs import first_of_each
from walkerkit.actuators.wrapped import XmlActuatorCfg
from walkerkit.walkers.reading import escaped

FILE = "actuators.json"
_CONFIGS: Mapping[str, type[XmlActuatorCfg]] = {
    "position": XmlPositionActuatorCfg,
    "velocity": XmlVelocityActuatorCfg,
    "effort": XmlMotorActuatorCfg,
}


@dataclass(frozen=True, kw_only=True)
class SavedActuators:
    """A robot's actuators, as its file and what lies beside it say.

    Attributes:
        actuators: configs of its actuators.
        laws: drivetrain laws of its joints.
    """

    actuators: tuple[ActuatorCfg, ...]
    laws: tuple[DrivetrainLaw, ...] = ()


def saved_actuators(
    path: str | Path, *, stopgap: bool = False, joints: Collection[str] | None = None
) -> SavedActuators:
    """Reads what belongs to a model beside its MJCF.

    Args:
        path: the model's file.
        stopgap: take the learned drives that the workflow left where no effect of its catalogue
            fits, instead of the drives that the model has.
        joints: those that the robot has, as PyMJCF calls them, of a file that has more in it; all
            by default.

    Returns:
        What was found. There are no configs where no joint's actuator takes a target, and all of
        the file's stay as they are.

    Raises:
        ValueError: the file is not one of the gap workflow's, or has no stopgap for this model, or
            nothing in it is driven.
    """
    path = Path(path)
    beside = path.parent / FILE
    if not beside.is_file():
        if stopgap:
            raise ValueError(f"{path}: there is no {FILE} beside it, so it has no stopgap")
        return SavedActuators(actuators=_taken_over(path, joints, {}))
    try:
        entry = json.loads(beside.read_text(encoding="utf-8"))["models"].get(path.name)
        if entry is None:
            return SavedActuators(actuators=_taken_over(path, joints, {}))
        learned = _learned(entry.get("stopgap", {}), path.parent) if stopgap else {}
        found = SavedActuators(
            actuators=(
                *_taken_over(path, joints, entry["command"], without=learned),
                *learned.values(),
            ),
            laws=_laws(entry.get("laws", {})),
        )
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(
            f"{beside}: is none of the gap workflow's ({type(error).__name__}: {error}); write it "
            "with `walkerkit diagnose`, or move it away"
        ) from None
    if stopgap and not learned:
        raise ValueError(f"{beside}: has no stopgap for {path.name}; leave stopgap out")
    return found


def _taken_over(
    path: Path,
    joints: Collection[str] | None,
    commands: Mapping[str, Any],
    *,
    without: Collection[str] = (),
) -> tuple[ActuatorCfg, ...]:
    """The XML's actuators of joints.

    Args:
        path: the model's file.
        joints: as for `saved_actuators`.
        commands: joint to what each kind of target means, where that is not what the XML says.
        without: joints that are left out.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    if not model.nactuator:
        raise ValueError(
            f"{path}: it has no actuator; give configs of the actuators that its joints are to have"
        )
    alone: dict[tuple[str, bool], dict[str, Mapping[str, Any] | None]] = {}
    several: dict[tuple[str, ...], dict[str, Mapping[str, Any]]] = {}
    for joint in range(model.njnt):
        name = model.joint(joint).name
        known = joints is None or escaped(name) in joints
        if not name or not known or name in without:
            continue
        ids = [a for a in range(model.nactuator) if on_joint(model, a) == joint]
        drives = first_of_each(drive for a in ids for drive in read_inputs(model, a))
        given = commands.get(name, {})
        if len(ids) == 1 and len(drives) == 1 and next(iter(drives.values())).law == "affine":
            (drive,) = drives.values()
            scale = given.get(drive.kind)
            alone.setdefault((drive.kind, scale is None), {})[name] = scale
        elif drives:
            several.setdefault(tuple(drives), {})[name] = given
    return (
        *(
            _of_kind(config, alone[kind, as_in_xml])
            for kind, config in _CONFIGS.items()
            for as_in_xml in (False, True)
            if (kind, as_in_xml) in alone
        ),
        *(_of_several(targets, of_joints) for targets, of_joints in several.items()),
    )


def _of_kind(
    config: type[XmlActuatorCfg], of_joints: Mapping[str, Mapping[str, Any] | None]
) -> ActuatorCfg:
    """One config for joints with one actuator each, with what a target means to each or none."""
    names = tuple(map(_exactly, of_joints))
    known = {_exactly(joint): scale for joint, scale in of_joints.items() if scale is not None}
    if not known:
        return config(joint_names_expr=names)
    return config(
        joint_names_expr=names,
        slope={joint: _finite(scale["slope"]) for joint, scale in known.items()},
        offset={joint: _finite(scale["offset"]) for joint, scale in known.items()},
    )


def _of_several(targets: Sequence[str], of_joints: Mapping[str, Mapping[str, Any]]) -> ActuatorCfg:
    """One config for joints with several controls each."""
    scales = {
        target: {
            escaped(joint): (_finite(known[kind]["slope"]), _finite(known[kind]["offset"]))
            for joint, known in of_joints.items()
            if kind in known
        }
        for target in targets
        for kind in (target.removesuffix("_target"),)
    }
    return XmlInputsActuatorCfg(
        joint_names_expr=tuple(map(_exactly, of_joints)),
        scales={target: of_joint for target, of_joint in scales.items() if of_joint},
    )


def _laws(of_joints: Mapping[str, Any]) -> tuple[DrivetrainLaw, ...]:
    """One law of each kind, with numbers per joint."""
    kinds: dict[str, dict[str, Mapping[str, Any]]] = {}
    for joint, laws in of_joints.items():
        for name, parameters in laws.items():
            kinds.setdefault(name, {})[_exactly(joint)] = parameters
    found = []
    for name, of_kind in kinds.items():
        if name not in LAWS:
            raise KeyError(f"no law {name!r}{closest(name, LAWS)}; there are {listed(LAWS)}")
        law = LAWS[name]
        numbers = {
            parameter: {joint: _finite(given[parameter]) for joint, given in of_kind.items()}
            for parameter in law.parameter_names()
        }
        found.append(law(joint_names_expr=tuple(of_kind), **numbers))
    return tuple(found)


def _learned(of_joints: Mapping[str, Any], folder: Path) -> dict[str, ActuatorCfg]:
    found: dict[str, ActuatorCfg] = {}
    for joint, fields in of_joints.items():
        own = {name: value for name, value in fields.items() if name != "lag"}
        own["network_file"] = folder / fields["network_file"]
        if not own["network_file"].resolve().is_relative_to(folder.resolve()):
            raise TypeError(f"network_file {fields['network_file']!r} lies outside of {folder}")
        drive = LearnedMlpActuatorCfg(joint_names_expr=(_exactly(joint),), **own)
        lag = int(fields["lag"])
        found[joint] = (
            DelayedActuatorCfg(base_cfg=drive, delay_min_lag=lag, delay_max_lag=lag)
            if lag
            else drive
        )
    return found


def _exactly(joint: str) -> str:
    """The expression that matches this joint alone, as PyMJCF calls it."""
    return re.escape(escaped(joint))


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise TypeError(f"{value!r} is not a finite number")
    return number
