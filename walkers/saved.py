"""What `actuators.json` says of a robot that the gap workflow has mended, for its walker.

    saved = saved_actuators("out/model.xml")
    walker = MjcfWalker.from_file("out/model.xml", saved.actuators, laws=saved.laws)

`MjcfWalker.from_file("out/model.xml")` alone does the same, unless the law of an actuator runs in
Python: no file holds that, so its config has to be given to `saved_actuators`. The file lies beside
the model; without one the robot's own actuators are taken over as the XML has them. What lies
between a joint and its log (`measurement`) belongs to a replay and not to a walker, which has no
log.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
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
from walkerkit.actuators.drivetrain import DrivetrainLaw, UnknownLawError, law_named
from walkerkit.actuators.explicit import AdoptedMotorCfg, ExplicitActuatorCfg
from walkerkit.actuators.inputs import first_of_each
from walkerkit.actuators.messages import listed
from walkerkit.actuators.wrapped import XmlActuatorCfg
from walkerkit.walkers.robot_file import escaped

FILE = "actuators.json"
Lags = tuple[tuple[str, int], ...]
"""Kinds of targets, each with how many physics steps they are late."""
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
    path: str | Path,
    *,
    stopgap: bool = False,
    in_python: Sequence[ActuatorCfg] = (),
    joints: Collection[str] | None = None,
) -> SavedActuators:
    """Reads what belongs to a model beside its MJCF.

    Args:
        path: the model's file.
        stopgap: take the learned drives that the workflow left where no effect of its catalogue
            fits, instead of the drives that the model has.
        in_python: configs of actuators whose laws run in Python; the file says which numbers they
            have come to.
        joints: those that the robot has, as PyMJCF calls them, of a file that has more in it; all
            by default.

    Returns:
        What was found. There are no configs where no joint's actuator takes a target, and all of
        the file's stay as they are.

    Raises:
        ValueError: the file is not one of the gap workflow's, has no stopgap for this model, or
            has laws in Python of which no config is given; or nothing in it is driven.
    """
    path = Path(path)
    beside = path.parent / FILE
    if not beside.is_file():
        if stopgap:
            raise ValueError(f"{path}: there is no {FILE} beside it, so it has no stopgap")
        return SavedActuators(actuators=_taken_over(path, _compiled(path), joints, {}))
    try:
        entry = json.loads(beside.read_text(encoding="utf-8"))["models"].get(path.name)
        if entry is None:
            return SavedActuators(actuators=_taken_over(path, _compiled(path), joints, {}))
        learned = _learned(entry.get("stopgap", {}), path.parent) if stopgap else {}
        python = _in_python(entry.get("in_python", {}), joints, learned)
        model = _compiled(path)
        step = float(model.opt.timestep)
        found = SavedActuators(
            actuators=(
                *_taken_over(path, model, joints, entry["command"], without={*learned, *python}),
                *_with_numbers(python, in_python, step, beside),
                *learned.values(),
            ),
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


def _in_python(
    entry: Mapping[str, Any], joints: Collection[str] | None, learned: Collection[str]
) -> dict[str, Any]:
    """What the file says of the joints whose laws run in Python, where no learned drive is."""
    return {j: of for j, of in entry.items() if j not in learned and _has(joints, j)}


def _taken_over(
    path: Path,
    model: mujoco.MjModel,
    joints: Collection[str] | None,
    commands: Mapping[str, Any],
    *,
    without: Collection[str] = (),
) -> tuple[ActuatorCfg, ...]:
    """The XML's actuators of joints.

    Args:
        path: the model's file.
        model: what it compiles to.
        joints: as for `saved_actuators`.
        commands: joint to what each kind of target means, where that is not what the XML says.
        without: joints that are left out.
    """
    if not model.nactuator:
        raise ValueError(
            f"{path}: it has no actuator; give configs of the actuators that its joints are to have"
        )
    alone: dict[tuple[str, bool, Lags], dict[str, Mapping[str, Any] | None]] = {}
    several: dict[tuple[tuple[tuple[str, str], ...], Lags], dict[str, Mapping[str, Any]]] = {}
    for joint in range(model.njnt):
        name = model.joint(joint).name
        if not name or not _has(joints, name) or name in without:
            continue
        ids = [a for a in range(model.nactuator) if on_joint(model, a) == joint]
        drives = first_of_each(drive for a in ids for drive in read_inputs(model, a))
        given = commands.get(name, {})
        kinds = {target: drive.kind for target, drive in drives.items()}
        lags = _lags(given, kinds.values(), float(model.opt.timestep))
        if len(ids) == 1 and len(drives) == 1 and next(iter(drives.values())).law == "affine":
            (kind,) = kinds.values()
            scale = given.get(kind)
            alone.setdefault((kind, scale is None, lags), {})[name] = scale
        elif drives:
            several.setdefault((tuple(kinds.items()), lags), {})[name] = given
    order = list(_CONFIGS)
    return (
        *(
            _delayed(_of_kind(_CONFIGS[kind], of_joints), dict(lags))
            for (kind, as_in_xml, lags), of_joints in sorted(
                alone.items(), key=lambda one: (order.index(one[0][0]), one[0][1])
            )
        ),
        *(
            _delayed(_of_several(dict(kinds), of_joints), dict(lags))
            for (kinds, lags), of_joints in several.items()
        ),
    )


def _compiled(path: Path) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(path))


def _has(joints: Collection[str] | None, name: str) -> bool:
    """Whether a robot has a joint."""
    return joints is None or escaped(name) in joints


def _lags(command: Mapping[str, Any], kinds: Collection[str], step: float) -> Lags:
    """The kinds of a joint's targets that are late."""
    return tuple(
        (kind, lag)
        for kind in kinds
        if kind in command and (lag := round(_finite(command[kind].get("late", 0.0)) / step))
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


def _of_several(
    kinds: Mapping[str, str], of_joints: Mapping[str, Mapping[str, Any]]
) -> ActuatorCfg:
    """One config for joints with several controls each, by target the kind of what takes it."""
    scales = {
        target: {
            escaped(joint): (_finite(known[kind]["slope"]), _finite(known[kind]["offset"]))
            for joint, known in of_joints.items()
            if kind in known
        }
        for target, kind in kinds.items()
    }
    return XmlInputsActuatorCfg(
        joint_names_expr=tuple(map(_exactly, of_joints)),
        scales={target: of_joint for target, of_joint in scales.items() if of_joint},
    )


def _delayed(base: ActuatorCfg, lags: Mapping[str, int]) -> ActuatorCfg:
    """An actuator behind a delay of so many steps, alike for the targets that have one."""
    # Volts are asked for by effort targets.
    late = {"effort" if kind == "voltage" else kind: lag for kind, lag in lags.items() if lag}
    if not late:
        return base
    lag = max(late.values())
    return DelayedActuatorCfg(
        base_cfg=base, delay_target=tuple(late), delay_min_lag=lag, delay_max_lag=lag
    )


def _with_numbers(
    of_joints: Mapping[str, Any], cfgs: Sequence[ActuatorCfg], step: float, beside: Path
) -> list[ActuatorCfg]:
    """Configs of laws in Python with the numbers of a file, working through the XML's motors."""
    left, found = dict(of_joints), list[ActuatorCfg]()
    for given in cfgs:
        cfg = getattr(given, "base_cfg", given)
        cfg = getattr(cfg, "law_cfg", cfg)
        if not isinstance(cfg, ExplicitActuatorCfg):
            raise ValueError(
                f"in_python has {given!r}, whose law does not run in Python: leave it out"
            )
        by_lag: dict[Lags, dict[str, Any]] = {}
        for joint in [j for j in left if _matches(cfg.joint_names_expr, j)]:
            of = left.pop(joint)
            lags = tuple((kind, round(_finite(late) / step)) for kind, late in of["late"].items())
            by_lag.setdefault(lags, {})[_exactly(joint)] = of["numbers"]
        for lags, numbers in by_lag.items():
            changed: dict[str, Any] = {
                item.name: {joint: _finite(own[item.name]) for joint, own in numbers.items()}
                for item in fields(cfg)
                if item.metadata.get("per_joint") and all(item.name in n for n in numbers.values())
            }
            law = replace(cfg, joint_names_expr=tuple(numbers), **changed)
            found.append(_delayed(AdoptedMotorCfg(law_cfg=law), dict(lags)))
    if left:
        kinds = listed(dict.fromkeys(of["config"].rpartition(".")[2] for of in left.values()))
        raise ValueError(
            f"{beside}: the law of {listed(left)} runs in Python ({kinds}), which no file holds. "
            "Give its config: saved = saved_actuators(path, in_python=[config]), and then "
            "MjcfWalker.from_file(path, saved.actuators, laws=saved.laws)"
        )
    return found


def _matches(expressions: Sequence[str], joint: str) -> bool:
    return any(re.fullmatch(expression, escaped(joint)) for expression in expressions)


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
    for joint, given in of_joints.items():
        own = {name: value for name, value in given.items() if name != "lag"}
        own["network_file"] = folder / given["network_file"]
        if not own["network_file"].resolve().is_relative_to(folder.resolve()):
            raise TypeError(f"network_file {given['network_file']!r} lies outside of {folder}")
        drive = LearnedMlpActuatorCfg(joint_names_expr=(_exactly(joint),), **own)
        lag = int(given["lag"])
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
