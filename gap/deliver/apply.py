"""The findings of a diagnosis in any other model of the same robot.

    applied = apply("result", "scene.xml", out="mended_scene.xml")
    for line in applied.changes: ...       # "joint FL_calf_joint: frictionloss 0.2 → 0.71"

The named effects are put on the model anew, so that its own actuators, geoms and units count, and
its numbers become those of the diagnosis. The file keeps every byte but those attributes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from walkerkit.gap.deliver.findings import Findings, read_findings
from walkerkit.gap.deliver.markup import Edit
from walkerkit.gap.deliver.reapply import reapplied, set_for_the_recordings
from walkerkit.gap.deliver.versions import needed
from walkerkit.gap.deliver.written import Patched, patched, place
from walkerkit.gap.errors import InputError, one_line, some
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Measurement, Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar

_NEW = "new element"
_HISTORY = (
    "the delayed actuators act on zeros after a reset until commands arrive. Fill what they "
    "remember with mujoco.mj_initCtrlHistory, as walkers of walkerkit do."
)


@dataclass(frozen=True, kw_only=True)
class Applied:
    """What `apply` has done.

    Attributes:
        files: the files that it wrote, the model first.
        changes: every attribute that it changed, a line for all elements that change alike.
        beside: what MJCF cannot say and actuators.json has, a line each.
        notes: what a user should know, a sentence each.
        needs: what of it takes a newer MuJoCo than the model did, to the first version.
    """

    files: tuple[Path, ...]
    changes: tuple[str, ...]
    beside: tuple[str, ...]
    notes: tuple[str, ...]
    needs: Mapping[str, str]


def apply(
    folder: str | Path,
    model: str | Path,
    *,
    out: str | Path,
    effects: Sequence[str] = (),
    overwrite: bool = False,
    allow_outside: bool = False,
) -> Applied:
    """Writes what a diagnosis has found into another model of the same robot.

    Args:
        folder: what `diagnose` has saved.
        model: an MJCF file with joints of the same names.
        out: the file to write. In the model's folder, an included file that changes is written
            under a new name beside it; in another one, all that the model needs is copied there.
        effects: names of the effects to apply; all by default.
        overwrite: whether files that are there may be replaced, the model itself too.
        allow_outside: the model's files may lie outside of its folder.

    Returns:
        What was done.

    Raises:
        InputError: the folder is none of ours, the model lacks a joint or a body, or its file
            cannot say what was found.
    """
    found, model, out = read_findings(Path(folder)), Path(model), Path(out)
    given = with_sidecar(load_robot(model, allow_outside=allow_outside), model)
    mended, notes = reapplied(found, given, effects)
    if not effects:
        notes = (*notes, *set_for_the_recordings(found))
    beside_it = out.parent.resolve() == model.parent.resolve()
    prefix = f"{out.stem}_" if beside_it and out.resolve() != model.resolve() else ""
    try:
        text = patched(given, mended, prefix=prefix)
    except (ValueError, OSError) as error:
        raise InputError(
            f"{model}: cannot be changed in its own text: {one_line(error)}. Write the elements "
            "out in the file, or use model.xml of the diagnosis."
        ) from None
    if beside_it:
        text = replace(text, files={})
    _check_free(text, out, overwrite=overwrite)
    out.parent.mkdir(parents=True, exist_ok=True)
    place(text, out)
    beside = _beside(mended)
    if mended.model.actuator_delay.any() and not given.model.actuator_delay.any():
        notes = (*notes, _HISTORY)
    written = [out, *(out.parent / name for name in text.others)]
    if beside or _read_otherwise(mended, out):
        written.append(_write_beside(mended, out, found))
    return Applied(
        files=tuple(written),
        changes=_lines(text.edits),
        beside=beside,
        notes=notes,
        needs=needed(text.edits),
    )


def _check_free(text: Patched, main: Path, *, overwrite: bool) -> None:
    for path in (main, *(main.parent / name for name in (*text.others, *text.files))):
        if path.exists() and not overwrite:
            raise InputError(
                f"{path}: is there already. Give another file with --out, or replace it with "
                "--overwrite."
            )


def _lines(edits: Iterable[Edit]) -> tuple[str, ...]:
    """A line for each change, which elements that change alike share."""
    names: dict[tuple[str, str], list[str]] = {}
    for edit in edits:
        what = f"{_NEW} {edit.now}"
        if edit.attribute:
            was = "(none of its own)" if edit.was is None else _short(edit.was)
            what = f"{edit.attribute} {was} → {_short(edit.now)}"
        name = edit.node.get("name") or edit.node.get("joint") or ""
        names.setdefault((edit.node.tag, what), []).append(name)
    lines = []
    for (tag, what), found in names.items():
        of_it = some(found).replace("'", "") if len(found) > 1 else found[0]
        lines.append(f"{tag} {of_it}".rstrip() + f": {what}")
    return tuple(lines)


def _short(text: str) -> str:
    """Numbers of an attribute in six digits; the file has all of them."""
    try:
        return " ".join(f"{float(number):.6g}" for number in text.split())
    except ValueError:
        return text


def _beside(robot: Robot) -> tuple[str, ...]:
    """What only actuators.json says of a robot."""
    lines = [
        f"{joint}: law {law} ({', '.join(f'{k} {v:.4g}' for k, v in parameters.items())})"
        for joint, laws in robot.laws.items()
        for law, parameters in laws.items()
    ]
    ideal = Measurement()
    lines += [
        f"{joint}: the log's {name} {getattr(measured, name):.4g}"
        for joint, measured in robot.measurement.items()
        for name in vars(ideal)
        if getattr(measured, name) != getattr(ideal, name)
    ]
    return tuple(lines)


def _read_otherwise(robot: Robot, path: Path) -> bool:
    """Whether the file alone would give targets another meaning."""
    alone = load_robot(path, allow_outside=True)
    return any(
        (one.slope, one.offset) != (other.slope, other.offset)
        for name, joint in robot.joints.items()
        for one, other in zip(joint.drives, alone.joints[name].drives, strict=True)
    )


def _write_beside(robot: Robot, path: Path, found: Findings) -> Path:
    beside = path.parent / FILE
    content: dict[str, Any] = sidecar({path.name: robot}, found.effects)
    if beside.is_file():
        try:
            known = json.loads(beside.read_text(encoding="utf-8"))
            known["models"] |= content["models"]
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{beside}: is no actuators.json of ours ({one_line(error)}). Move it away."
            ) from None
        content = known
    beside.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return beside
