"""`actuators.json`: what the mended MJCF cannot say, beside the model that it belongs to.

Per model: how targets in joint units become controls, what they are between samples, and what
lies between a joint and its log. Loading a model reads the entry of its name from the file in the
same folder.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from walkerkit.actuators.drive import Drive
from walkerkit.actuators.drivetrain import UnknownLawError, law_named
from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.robot import Joint, Measurement, Robot

FILE = "actuators.json"
SCHEMA = 1


def sidecar(robots: Mapping[str, Robot], named: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of actuators.json.

    Args:
        robots: model file name to the mended robot.
        named: the named effects, as in diagnosis.json.
    """
    return {
        "schema": SCHEMA,
        "effects": named,
        "models": {name: _entry(robot) for name, robot in robots.items()},
    }


def with_sidecar(robot: Robot, model_path: Path, *, given: Robot | None = None) -> Robot:
    """The robot with what the file beside its model says; unchanged where there is none.

    Args:
        robot: the robot, as its file has it.
        model_path: that file.
        given: the robot whose laws in Python the file's are; with it, that robot is returned with
            what the file says beside them.

    Raises:
        InputError: the file is not one of ours, or names a joint that the model lacks.
    """
    path = model_path.parent / FILE
    if not path.is_file():
        return robot
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))["models"].get(model_path.name)
        if entry is None:
            return robot
        if entry.get("in_python") and given is not None and given.programs:
            robot = given
        elif entry.get("in_python"):
            joints = entry["in_python"]
            raise InputError(
                f"{path}: the law of {', '.join(map(repr, joints))} runs in Python "
                f"({next(iter(joints.values()))['config']}), which no file holds. Give as the "
                "model a `package.module:callable` that returns the walker, made with "
                f"walkerkit.walkers.saved.saved_actuators({str(model_path)!r}, in_python=[config])."
            )
        robot.check_joints(
            [*entry["command"], *entry["measurement"], *entry.get("laws", {})], str(path)
        )
        return replace(
            robot,
            hold=entry["hold"],
            joints={name: _commanded(j, entry["command"]) for name, j in robot.joints.items()},
            measurement={
                name: Measurement(**{key: _finite(number) for key, number in values.items()})
                for name, values in entry["measurement"].items()
            },
            laws={
                joint: {law: _parameters(law, values) for law, values in laws.items()}
                for joint, laws in entry.get("laws", {}).items()
            },
        )
    except InputError:
        raise
    except UnknownLawError as error:
        raise InputError(f"{path}: {error}.") from None
    except (ValueError, KeyError, TypeError, AttributeError, OSError, RecursionError) as error:
        raise InputError(
            f"{path}: is no actuators.json of schema {SCHEMA} ({type(error).__name__}: {error}). "
            "Write it with `walkerkit diagnose`, or move it away."
        ) from None


def _entry(robot: Robot) -> dict[str, Any]:
    ideal = asdict(Measurement())
    return {
        "hold": robot.hold,
        "command": {
            # Targets go to the first drive of their kind.
            name: {d.kind: _scale(d) for d in reversed(joint.commanded)}
            for name, joint in robot.joints.items()
            if joint.commanded and not joint.in_python
        },
        **_in_python(robot),
        "measurement": {
            name: {key: number for key, number in asdict(measured).items() if number != ideal[key]}
            for name, measured in robot.measurement.items()
            if measured != Measurement()
        },
        "laws": {joint: dict(laws) for joint, laws in robot.laws.items()},
    }


def _scale(drive: Drive) -> dict[str, float]:
    late = {"late": drive.late} if drive.late else {}
    return {"slope": drive.slope, "offset": drive.offset, **late}


def _in_python(robot: Robot) -> dict[str, Any]:
    """What a file can say of laws in Python: whose they are, and with which numbers."""
    if not robot.programs:
        return {}
    return {
        "in_python": {
            joint: {
                "config": f"{type(program.cfg).__module__}.{type(program.cfg).__qualname__}",
                "late": {
                    drive.kind: drive.late for drive in robot.joints[joint].commanded if drive.late
                },
                "numbers": {
                    name: float(values[k])
                    for name, values in program.numbers.items()
                    if math.isfinite(values[k])
                },
            }
            for program in robot.programs
            for k, joint in enumerate(program.joints)
        }
    }


def _parameters(law: str, values: Mapping[str, Any]) -> dict[str, float]:
    names = law_named(law).parameter_names()
    if sorted(values) != sorted(names):
        raise ValueError(f"{law} has the parameters {list(names)}, not {list(values)}")
    return {name: _finite(values[name]) for name in names}


def _commanded(joint: Joint, command: Mapping[str, Any]) -> Joint:
    known = dict(command.get(joint.name, {}))

    def own(drive: Drive) -> Drive:
        scale = known.pop(drive.kind, None)  # it is of the first drive of its kind
        if scale is None:
            return drive
        return replace(
            drive,
            slope=_finite(scale["slope"]),
            offset=_finite(scale["offset"]),
            late=_finite(scale.get("late", 0.0)),
        )

    return replace(
        joint,
        drives=tuple(map(own, joint.drives)),
        inputs=tuple(map(own, joint.inputs)),
    )


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not a finite number")
    return number
