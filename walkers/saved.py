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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from walkerkit.actuators import (
    ActuatorCfg,
    DelayedActuatorCfg,
    LearnedMlpActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)
from walkerkit.actuators.drive import Drive, drives_of_joint
from walkerkit.actuators.drivetrain import DrivetrainLaw, UnknownLawError, law_named
from walkerkit.walkers.reading import escaped

FILE = "actuators.json"
_CONFIGS = {
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


def saved_actuators(path: str | Path, *, stopgap: bool = False) -> SavedActuators:
    """Reads what belongs to a model beside its MJCF.

    Args:
        path: the model's file.
        stopgap: take the learned drives that the workflow left where no effect of its catalogue
            fits, instead of the drives that the model has.

    Raises:
        ValueError: the file is not one of the gap workflow's, or has no stopgap for this model.
    """
    path = Path(path)
    beside = path.parent / FILE
    if not beside.is_file():
        if stopgap:
            raise ValueError(f"{path}: there is no {FILE} beside it, so it has no stopgap")
        return _as_in_the_xml(path)
    try:
        entry = json.loads(beside.read_text(encoding="utf-8"))["models"].get(path.name)
        if entry is None:
            return _as_in_the_xml(path)
        learned = _learned(entry.get("stopgap", {}), path.parent) if stopgap else {}
        commands = {j: by_kind for j, by_kind in entry["command"].items() if j not in learned}
        found = SavedActuators(
            actuators=(*_taken_over(commands), *learned.values()),
            laws=_laws(entry.get("laws", {})),
        )
    except UnknownLawError as error:
        raise ValueError(f"{beside}: {error}") from None
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(
            f"{beside}: is none of the gap workflow's ({type(error).__name__}: {error}); write it "
            "with `walkerkit diagnose`, or move it away"
        ) from None
    if stopgap and not learned:
        raise ValueError(f"{beside}: has no stopgap for {path.name}; leave stopgap out")
    return found


def _as_in_the_xml(path: Path) -> SavedActuators:
    model = mujoco.MjModel.from_xml_path(str(path))
    kinds: dict[str, str] = {}
    for joint in range(model.njnt):
        drives: tuple[Drive, ...] = drives_of_joint(model, joint)
        if drives and model.joint(joint).name:
            kinds[model.joint(joint).name] = drives[0].kind
    if not kinds:
        raise ValueError(
            f"{path}: none of its joints has a position, velocity or effort actuator; give configs "
            "of the actuators that they are to have"
        )
    return SavedActuators(
        actuators=tuple(
            config(joint_names_expr=tuple(_exactly(j) for j, kind in kinds.items() if kind == one))
            for one, config in _CONFIGS.items()
            if one in kinds.values()
        )
    )


def _taken_over(commands: Mapping[str, Any]) -> list[ActuatorCfg]:
    """The XML's actuators, with what a target means to each."""
    found: list[ActuatorCfg] = []
    for kind, config in _CONFIGS.items():
        of_kind = {_exactly(j): by_kind[kind] for j, by_kind in commands.items() if kind in by_kind}
        if of_kind:
            found.append(
                config(
                    joint_names_expr=tuple(of_kind),
                    slope={joint: _finite(scale["slope"]) for joint, scale in of_kind.items()},
                    offset={joint: _finite(scale["offset"]) for joint, scale in of_kind.items()},
                )
            )
    return found


def _laws(of_joints: Mapping[str, Any]) -> tuple[DrivetrainLaw, ...]:
    """One law of each kind, with numbers per joint."""
    kinds: dict[str, dict[str, Mapping[str, Any]]] = {}
    for joint, laws in of_joints.items():
        for name, parameters in laws.items():
            kinds.setdefault(name, {})[_exactly(joint)] = parameters
    found = []
    for name, of_kind in kinds.items():
        law = law_named(name)
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
