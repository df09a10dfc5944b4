"""Named effects, put on another model of the robot that they were found on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from walkerkit.actuators.drivetrain import SupplyVoltage
from walkerkit.gap.deliver.findings import Findings
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE, Effect, Parameter
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Excursion, Robot
from walkerkit.gap.simulation.trials import Trials

# How far the joints went is not asked here; nothing that was found is too small to be there.
_SLIGHT = Excursion(lower=-5e-7, upper=5e-7)
_OF_THE_RIG = ("base_tilt", "mount_compliance")  # where the robot was mounted, not of the robot
_OF_TARGETS = ("command_delay",)  # which of a servo is another thing than of a motor
_DIGITS = 1e-5  # of a number in diagnosis.json
_ADDS = 1e-4  # how well a sum has to be met by numbers of six digits


def reapplied(
    found: Findings, robot: Robot, wanted: Sequence[str]
) -> tuple[Robot, tuple[str, ...]]:
    """A robot with the effects of a diagnosis.

    Numbers that were added to what the diagnosed model had become, in this one, what they came to
    there; where several effects have changed the same number, their sum is added.

    Args:
        found: the diagnosis.
        robot: another model of the robot.
        wanted: names of the effects; none for all.

    Returns:
        The mended robot, and what a user should know.

    Raises:
        InputError: the robot lacks a joint or a body, or an effect cannot act on it.
    """
    named = [effect["effect"] for effect in found.effects]
    for name in wanted:
        if name not in named:
            raise InputError(
                f"{found.folder}: effect {name!r} was not named there{closest(name, named)}; "
                f"there {'are' if len(named) > 1 else 'is'} {', '.join(named) or 'none'}. "
                "Name one of them with --effect, or leave it out."
            )
    seen = {name: replace(_SLIGHT, voltage=_voltage(found, name)) for name in robot.joints}
    robot = replace(robot, excursions=seen)
    trials, notes, left_out = Trials(robot, 1), list[str](), of_the_mount(found, robot)
    for of in found.effects:
        effect = CATALOGUE[of["effect"]]
        if wanted and effect.name not in wanted:
            continue
        if effect.name in left_out:
            notes.append(
                f"{effect.name} was left out: it is of the mount on which the robot was "
                "diagnosed, and this one floats."
            )
            continue
        sites = _sites(found, of, effect, robot)
        if effect.name in _OF_TARGETS:
            notes += _other_targets(found, effect, sites, robot)
        for site in sites:
            effect.apply(trials, site, _values(of, effect, robot, site, notes)[None])
    mended = mend(trials)
    return replace(mended, hold=found.robot.hold or robot.hold), tuple(dict.fromkeys(notes))


def set_for_the_recordings(found: Findings) -> tuple[str, ...]:
    """What of a diagnosis may be how the drives were set for the recordings, a sentence."""
    names = [of["effect"] for of in found.effects]
    if "effort_limit" not in names:
        return ()
    others = " ".join(f"--effect {name}" for name in names if name != "effort_limit")
    return (
        "effort_limit is no property of the robot if the drives were limited for the recordings"
        + (f": leave it out then, with {others}." if others else "; nothing is left then."),
    )


def of_the_mount(found: Findings, robot: Robot) -> tuple[str, ...]:
    """Names of the effects that a robot lacks because it floats and the diagnosed one does not."""
    if robot.base is None or found.robot.base is not None:
        return ()
    return tuple(of["effect"] for of in found.effects if of["effect"] in _OF_THE_RIG)


def _voltage(found: Findings, joint: str) -> tuple[float, float, float] | None:
    """The voltage that was usual in the recordings, if it has varied; a law has kept it."""
    law = found.robot.laws.get(joint, {}).get(SupplyVoltage.name)
    return None if law is None else (law["nominal"], 0.0, math.inf)


def _supplied(found: Findings) -> Robot:
    """The diagnosed robot with the voltage that its recordings had."""
    robot = found.robot
    seen = {
        name: replace(robot.excursion(name), voltage=_voltage(found, name)) for name in robot.joints
    }
    return replace(robot, excursions=seen)


def _sites(found: Findings, of: Mapping[str, Any], effect: Effect, robot: Robot) -> tuple[str, ...]:
    if effect.kind == "robot":
        sites: tuple[str, ...] = (EVERYWHERE,)
    elif effect.kind == "body":
        sites = tuple(of["bodies"])
        _check("body", sites, robot.bodies, found, robot)
    else:
        sites = tuple(of["joints"])
        if sites == (EVERYWHERE,):
            sites = effect.sites(_supplied(found), tuple(found.robot.joints))
        _check("joint", sites, robot.joints, found, robot)
    possible = effect.sites(robot, tuple(robot.joints))
    for site in sites:
        if site not in possible:
            kinds = {d.kind for joint in robot.joints.values() for d in joint.drives}
            raise InputError(
                f"{robot.source}: {effect.name} cannot act on {site!r} of this model, whose "
                f"actuators take {', '.join(sorted(kinds)) or 'nothing'}. Give the joint an "
                "actuator as the diagnosed model has it (`walkerkit servo` writes one), or name "
                "the other effects with --effect."
            )
    return sites


def _other_targets(
    found: Findings, effect: Effect, sites: Sequence[str], robot: Robot
) -> list[str]:
    """Says where targets of other kinds are late than those of the diagnosed model."""
    there, here = (
        [sorted({drive.kind for drive in one.joints[site].drives}) for site in sites]
        for one in (found.robot, robot)
    )
    other = [k for k in range(len(sites)) if there[k] != here[k]]
    if not other:
        return []
    return [
        f"{effect.name} was found where joints take {', '.join(there[other[0]])} targets. "
        f"Joints of this model ({', '.join(sites[k] for k in other)}) take "
        f"{', '.join(here[other[0]])} targets, and these are late now. Give the model with the "
        "servos that were diagnosed (`walkerkit servo` writes them)."
    ]


def _check(
    kind: str,
    names: Sequence[str],
    known: Sequence[str] | Mapping[str, Any],
    found: Findings,
    robot: Robot,
) -> None:
    for name in names:
        if name not in known:
            raise InputError(
                f"{robot.source}: there is no {kind} {name!r}{closest(name, known)}, of which "
                f"{found.folder} has found something. Give a model of the same robot, or name the "
                "other effects with --effect."
            )


def _values(
    of: Mapping[str, Any], effect: Effect, robot: Robot, site: str, notes: list[str]
) -> Any:
    """(n_parameters,) what makes of a robot's numbers those of the diagnosis."""
    given = {p["name"]: p for p in of["parameters"] if _place(p) in (site, EVERYWHERE)}
    parameters = effect.parameters(robot, site)
    known = {name for p in parameters for name in (p.name, *p.inverse[:1])}
    for name in given:
        if name not in known:
            raise InputError(
                f"{robot.source}: {effect.name} has no {name!r} at {site!r} of this model, which "
                "is not built as the diagnosed one. Name the other effects with --effect."
            )
    return np.array([_value(given, effect, p, robot, site, notes) for p in parameters])


def _place(parameter: Mapping[str, Any]) -> str:
    place: str = parameter["joint"] if "joint" in parameter else parameter["body"]
    return place


def _value(
    given: Mapping[str, Mapping[str, Any]],
    effect: Effect,
    parameter: Parameter,
    robot: Robot,
    site: str,
    notes: list[str],
) -> float:
    other_name, _ = parameter.inverse or ("", "")
    inverse = other_name in given
    found = given.get(other_name if inverse else parameter.name)
    if found is None:
        return parameter.zero
    was, now = _change(found, site)
    # The files of a drive whose law runs in Python have no number of it to be the same.
    known = site not in robot.joints or not robot.joints[site].in_python
    if known and was is not None and was == now:
        return parameter.zero
    value = float(found["value"])
    field = effect.fields.get(parameter.name)
    own = None if field is None else field.read(robot, site, robot)
    if own is not None and now is not None and own:
        there = 1 / own if inverse else own
        if math.isclose(there, now, rel_tol=_DIGITS):
            return parameter.zero  # it has been applied already
    if inverse:
        return 1 / value
    if was is None or now is None or own is None:
        return value
    if not math.isclose(now - was, value, rel_tol=_ADDS, abs_tol=_ADDS * abs(now)):
        return value
    if not math.isclose(own, was, rel_tol=_ADDS, abs_tol=1e-9):
        where = "the robot" if site == EVERYWHERE else site
        notes.append(
            f"{found['field']} of {where} is {own:.6g} in this model and was {was:.6g} in the "
            f"diagnosed one; it becomes {now:.6g} as there."
        )
        return now - own
    return value


def _change(found: Mapping[str, Any], site: str) -> tuple[float | None, float | None]:
    """What a number was and is at a site, of the first model that has it."""
    for one in found.get("each", ()):
        if one["place"] == site:
            return one["was"], one["is"]
    return found["was"], found["is"]
