"""Where no effect of the catalogue fits: a formula as a hint, a learned drive as a stopgap.

    result = with_hints(result)
    result.diagnosis.hints

Both are looked for at the joints that hold most of the remaining gap, and only where the verdict
leaves something to explain.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from walkerkit.gap.report.diagnosis import Diagnosis, Hint
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.regimes import EVERYWHERE
from walkerkit.gap.search.residual_effort import residual_effort
from walkerkit.gap.stopgap.learned_drive import LearnedDrive, learned_drive, why_none
from walkerkit.gap.stopgap.sparse import Formula, formula

if TYPE_CHECKING:
    from walkerkit.gap.report.result import Result

_UNEXPLAINED = ("unexplained", "partly_explained")
_MOST_JOINTS, _SHARE = 3, 0.1  # of the squared gap
_NO_FORMULA = (
    "There is no formula as a stopgap: none of positions, velocities and efforts makes the missing "
    "effort smaller where it was not fitted. Longer recordings may have one."
)
_USE = """\
from walkerkit.walkers import MjcfWalker
from walkerkit.walkers.saved import saved_actuators

saved = saved_actuators("model.xml", stopgap=True)
walker = MjcfWalker.from_file("model.xml", saved.actuators, laws=saved.laws)
"""


def with_hints(result: Result) -> Result:
    """The result with hints and stopgaps, where its verdict leaves something to explain.

    Args:
        result: what was found.
    """
    diagnosis, problem = result.diagnosis, result.problem
    joints = [
        at.joint
        for at in diagnosis.remaining
        if at.regime == EVERYWHERE and at.share >= _SHARE and at.joint in problem.joints
    ][:_MOST_JOINTS]
    floating = any(robot.base is not None for robot in result.robots)
    if diagnosis.verdict not in _UNEXPLAINED or floating or not joints:
        return result
    missing = residual_effort(problem, result.robots, joints)
    if missing is None:
        return result
    hints, drives, notes = [], [], list[str]()
    for k, joint in enumerate(joints):
        found = formula(missing, k)
        if found is not None:
            hints.append(_of_formula(result, joint, found))
        drive = _drive(result, joint)
        if drive is not None:
            drives.append(drive)
            hints.append(_of_drive(diagnosis, drive))
        else:
            notes.append(_no_drive(result, joint))
    if not any(hint.kind == "formula" for hint in hints):
        notes.insert(0, _NO_FORMULA)
    diagnosis = replace(diagnosis, hints=tuple(hints), notes=(*diagnosis.notes, *notes))
    return replace(result, diagnosis=diagnosis, stopgaps=tuple(drives))


def _no_drive(result: Result, joint: str) -> str:
    why = why_none(result.problem, result.robots[0], joint)
    because = why or "with one that was trained, held-out recordings are not followed much better"
    return f"There is no learned drive at {joint} as a stopgap: {because}."


def _drive(result: Result, joint: str) -> LearnedDrive | None:
    before = result.diagnosis.gap.joints[joint].after
    return learned_drive(result.problem, result.robots[0], joint, before=before)


def _of_formula(result: Result, joint: str, found: Formula) -> Hint:
    slide = result.robots[0].joints[joint].slide
    unit, length = ("N", "m") if slide else ("N·m", "rad")
    return Hint(
        kind="formula",
        joint=joint,
        title=f"A formula at {joint}",
        statement=f"missing effort ≈ {found.text}, in {unit}, {length} and {length}/s",
        signal="missing_effort",
        size=GapSize(unit=unit, before=found.before, after=found.after, noise_floor=0.0),
    )


def _of_drive(diagnosis: Diagnosis, drive: LearnedDrive) -> Hint:
    size = diagnosis.gap.joints[drive.joint]
    samples = drive.trained.history_length
    return Hint(
        kind="learned",
        joint=drive.joint,
        title=f"A learned drive at {drive.joint}",
        statement=(
            f"a network that makes the drive's effort of the last {samples} position errors and "
            "velocities; it knows no motion that it has not seen"
        ),
        signal="position",
        size=replace(size, before=drive.before, after=drive.after),
        use=_USE,
        file=stopgap_file(drive.joint),
    )


def stopgap_file(joint: str) -> str:
    """The name of the file of a joint's network."""
    return f"stopgap_{re.sub(r'[^A-Za-z0-9_.-]', '_', joint)}.npz"
