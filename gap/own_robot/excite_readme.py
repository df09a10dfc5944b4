"""What goes with the files of an excitation: safety, order, limits, and what to log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from walkerkit.tasks.excitation import BATTERY


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Where a joint is sent.

    Attributes:
        joint: its name.
        start: where all files begin and end [rad; m].
        lower, upper: the lowest and highest target [rad; m].
        speed: the fastest target [rad/s; m/s].
        slide: whether it is a slide joint.
    """

    joint: str
    start: float
    lower: float
    upper: float
    speed: float
    slide: bool


def readme(
    model: str,
    files: Sequence[str],
    limits: Sequence[Limits],
    *,
    seconds: float,
    rate: float,
    notes: Sequence[str],
) -> str:
    """The page, in Markdown.

    Args:
        model: what the targets were made for.
        files: their names, in the order in which they are to be sent.
        limits: of each joint.
        seconds: length of each file.
        rate: samples a second.
        notes: what else is to be said.
    """
    told = [f"# Targets for {model}", ""]
    told += [
        f"Each file has {seconds:g} s of position targets at {rate:g} Hz, in rad (m for slide "
        "joints): `time` and one column `<joint>/position_target` for each joint. All begin and "
        "end at rest at the start pose below.",
        "",
    ]
    told += [f"**{note[0].upper()}{note[1:]}.**\n" for note in notes]
    told += ["## Before", "", *(f"{k}. {line}" for k, line in enumerate(_SAFETY, 1)), ""]
    told += ["## Order", "", "| file | what it tells |", "|---|---|"]
    told += [f"| `{file}` | {_purpose(file)} |" for file in files]
    told += [
        "",
        "Look at each log before you send the next file: did every joint go where it was sent, and "
        "is every column there? Wait until the drives have cooled down.",
        "",
        "## Limits",
        "",
        "| joint | start | lowest | highest | fastest |",
        "|---|---|---|---|---|",
    ]
    for one in limits:
        unit = "m" if one.slide else "rad"
        told.append(
            f"| `{one.joint}` | {one.start:.3f} {unit} | {one.lower:.3f} | {one.upper:.3f} | "
            f"{one.speed:.2f} {unit}/s |"
        )
    told += [
        "",
        "## Log",
        "",
        "One row for each turn of the control loop, of what the drive was told and what it "
        "measured, stamped by one clock:",
        "",
        "| column | unit | |",
        "|---|---|---|",
        *(f"| `{name}` | {unit} | {need} |" for name, unit, need in _COLUMNS),
        "",
        f"The joints are {', '.join(f'`{one.joint}`' for one in limits)}. Other names, units and "
        "formats (bags, JSON, NPZ, …) are read by `walkerkit import LOG --model MODEL --out "
        "recordings`.",
        "",
        "## Then",
        "",
        "```",
        f"walkerkit compare {model} recordings/*.parquet",
        f"walkerkit diagnose {model} recordings/*.parquet --out diagnosis",
        "```",
        "",
    ]
    return "\n".join(told)


_SAFETY = (
    "Hang the robot up, or fix its trunk, so that no foot reaches anything.",
    "One person holds the emergency stop. It cuts the motors' power and is no software.",
    "Limit torque to a third and speed to a half in the drives, not in the script, and set their "
    "position limits inside of the mechanical ones.",
    "Let the motors warm up for a minute.",
    "Move slowly to the start pose, then begin.",
    "Stop by ramping the targets back to the start pose, never by switching the gains off.",
)

_COLUMNS = (
    ("time", "s", "required"),
    ("<joint>/position_target", "rad", "required: what the drive was told, after all filters"),
    ("<joint>/position", "rad", "required: as the encoder measured it"),
    ("<joint>/effort", "N·m", "the drive's current times its torque constant, if it has it"),
    ("<joint>/velocity", "rad/s", "as the drive reports it, if it does"),
)


def _purpose(file: str) -> str:
    """What a file is for."""
    name = file.removesuffix(".csv").partition("_")[2]
    small = name.startswith("small_")
    told = BATTERY[name.removeprefix("small_")].description
    return "a tenth as large: look at its log before all others" if small else told
