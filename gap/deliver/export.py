"""A diagnosis for a trainer: a model that it runs, its configs, laws as functions, ranges.

exported = export("result", "mjlab")       # result/mjlab/robot.py, model.xml, randomization.py
exported.lost                              # what the trainer cannot simulate, a line each
export("result", "mjlab", model="go2.xml") # the same findings in the robot that floats
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from walkerkit.gap.deliver import isaaclab, mjlab
from walkerkit.gap.deliver.findings import Findings, read_findings
from walkerkit.gap.deliver.law_code import law_code
from walkerkit.gap.deliver.randomization_code import posterior, randomization_code
from walkerkit.gap.deliver.reapply import of_the_mount, reapplied, set_for_the_recordings
from walkerkit.gap.deliver.suited import Laws, Suited, check, damps_at_its_limit, suited
from walkerkit.gap.deliver.trainers import MADE, TRAINERS, Trainer, way
from walkerkit.gap.deliver.written import write_mended
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import with_sidecar

_FIXED = (
    "the robot is fixed to the world here, as it was in the model that was diagnosed. --model FILE "
    "exports the one that floats."
)
_HISTORY = (
    "model.xml has delayed actuators, which act on zeros after a reset until commands arrive. Fill "
    "what they remember with `init_ctrl_history` of mujoco_warp (`mj_initCtrlHistory` of mujoco)."
)
_AT_THE_LIMIT = (
    "MJX goes on damping where a servo is at its limit, and MuJoCo does not. Where your servos "
    "reach theirs, call mjx_step of drivetrain.py; else mjx.step does."
)
_USES = {
    "mjx": """In place of every mjx.step:

    data, state = mjx_step(model, data, state, target)

with `state = start()` at the beginning of an episode, and targets in the order of JOINTS. Where the
steps have to stay your own, `before_step` says what to set before them.""",
    "torch": """Before every physics step, with (n_envs, n_joints) tensors in the order of JOINTS:

    state, ctrl, applied, dry = before_step(state, target, q, qd)

ctrl goes to the actuators, applied to qfrc_applied, and dry to dof_frictionloss.""",
}


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What `export` has written.

    Attributes:
        folder: where.
        files: the files.
        lost: what the trainer cannot simulate, a line each.
        notes: what a user should know, a sentence each.
    """

    folder: Path
    files: tuple[Path, ...]
    lost: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())


def export(
    folder: str | Path,
    to: str,
    *,
    model: str | Path | None = None,
    effects: Sequence[str] = (),
    out: str | Path | None = None,
    overwrite: bool = False,
    allow_outside: bool = False,
) -> Exported:
    """Writes a diagnosis in the words of a trainer.

    Args:
        folder: what `diagnose` has saved.
        to: `mjlab`, `isaaclab`, `mjx` or `warp`.
        model: an MJCF file with joints of the same names, to export with what was found; by
            default the model that was diagnosed.
        effects: names of the effects to export, where a model is given; all by default.
        out: the folder to write; by default one of the trainer's name in that of the diagnosis.
        overwrite: whether files that are there may be replaced.
        allow_outside: that model's files may lie outside of its folder.

    Returns:
        What was written, and what is lost.

    Raises:
        InputError: the folder is none of ours, the trainer is unknown, it cannot simulate the
            model and would not say so, or the effects cannot act on the model.
    """
    trainer = _known(to)
    found = read_findings(Path(folder))
    target = Path(folder) / to if out is None else Path(out)
    if target.exists() and any(target.iterdir()) and not overwrite:
        raise InputError(
            f"{target}: is not empty. Give another folder with --out, or replace its files with "
            "--overwrite."
        )
    found, given, told = _on(model, found, effects, allow_outside=allow_outside)
    told = (*told, *set_for_the_recordings(found))
    check(found.robot, trainer, found.folder if model is None else Path(model))
    ranges = randomization_code(posterior(found), trainer)
    target.mkdir(parents=True, exist_ok=True)
    suits = suited(found.robot, trainer)
    for path in target.glob("*"):
        if path.is_file():
            path.unlink()
    write_mended(given, suits.robot, target / "model.xml")
    notes = (*told, *_write_code(found, suits.robot, suits.laws, trainer, target))
    _write(target / "randomization.py", ranges)
    if suits.robot.model.actuator_delay.any():
        notes = (*notes, _HISTORY)
    if model is None and given.base is None:
        notes = (*notes, _FIXED)
    lost = (*suits.lost, *_lost(found, trainer))
    content = _content(found, suits, trainer, lost, notes)
    _write(target / "export.json", json.dumps(content, indent=2))
    files = tuple(path for path in sorted(target.rglob("*")) if path.is_file())
    return Exported(folder=target, files=files, lost=lost, notes=notes)


def _known(to: str) -> Trainer:
    """A trainer by its name.

    Raises:
        InputError: there is none of that name.
    """
    if to not in TRAINERS:
        raise InputError(
            f"--to {to}: is no trainer that is known{closest(to, TRAINERS)}; there are "
            f"{', '.join(TRAINERS)}. Name one of them."
        )
    return to


def _on(
    model: str | Path | None, found: Findings, effects: Sequence[str], *, allow_outside: bool
) -> tuple[Findings, Robot, tuple[str, ...]]:
    """What was found, on the diagnosed model or on another; that as given; what is to be said."""
    if model is None:
        if effects:
            raise InputError(
                f"--effect {effects[0]}: the diagnosed model has all effects in it. Give with "
                "--model the one that was diagnosed, or another of the robot, as it was before."
            )
        return found, found.robot, ()
    given = with_sidecar(load_robot(model, allow_outside=allow_outside), Path(model))
    mended, told = reapplied(found, given, effects)
    others = {one["effect"] for one in found.effects} - {*effects} if effects else set()
    found = found.without({*others, *of_the_mount(found, given)})
    return replace(found, robot=mended), given, told


def _lost(found: Findings, trainer: Trainer) -> Iterator[str]:
    """The effects that a trainer cannot simulate, with why."""
    for effect in found.effects:
        found_way = way(effect["effect"], trainer)
        if found_way.kind == "cannot":
            yield f"{effect['effect']}: {found_way.says}"


def _write_code(
    found: Findings, robot: Robot, laws: Laws, trainer: Trainer, target: Path
) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    left = laws
    if trainer in ("mjlab", "isaaclab"):
        write: Callable[[Robot, Laws], tuple[str, Laws, tuple[str, ...]]]
        name, write = {
            "mjlab": ("robot.py", mjlab.config),
            "isaaclab": ("actuators.py", isaaclab.config),
        }[trainer]
        text, left, notes = write(robot, laws)
        _write(target / name, text)
    ways = [way(effect["effect"], trainer) for effect in found.effects]
    needed = bool(left) or any(one.kind == "function" for one in ways)
    if not needed and trainer == "mjx" and damps_at_its_limit(robot):
        needed, notes = True, (*notes, _AT_THE_LIMIT)
    if needed:
        arrays = "jax" if trainer == "mjx" else "torch"
        code = law_code(robot, left, arrays, use=_USES.get(trainer, _USES["torch"]))  # type: ignore[arg-type]
        _write(target / MADE, code)
    return notes


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _content(
    found: Findings, suits: Suited, trainer: Trainer, lost: tuple[str, ...], notes: tuple[str, ...]
) -> dict[str, Any]:
    return {
        "to": trainer,
        "effects": {one["effect"]: vars(way(one["effect"], trainer)) for one in found.effects},
        "lost": list(lost),
        "apart": [list(pair) for pair in suits.apart],
        "notes": list(notes),
    }
