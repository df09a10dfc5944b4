"""What goes with the files of an excitation: safety, order, limits, and what to log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass


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


@dataclass(frozen=True, kw_only=True)
class Manner:
    """What differs between a robot that hangs and one that stands.

    Attributes:
        safety: what to do before, in order.
        columns: names, units and needs of the columns to log.
        tried: how the targets were tried, a paragraph; empty where they were not.
    """

    safety: tuple[str, ...]
    columns: tuple[tuple[str, str, str], ...]
    tried: str = ""


def readme(
    model: str,
    files: Mapping[str, str],
    limits: Sequence[Limits],
    manner: Manner,
    *,
    length: str,
    rate: float,
    notes: Sequence[str],
) -> str:
    """The page, in Markdown.

    Args:
        model: what the targets were made for.
        files: name to what it tells, in the order in which they are to be sent.
        limits: of each joint.
        manner: whether the robot hangs or stands.
        length: of a file, in words.
        rate: samples a second.
        notes: what else is to be said.
    """
    told = [f"# Targets for {model}", ""]
    told += [
        f"Each file has {length} of position targets at {rate:g} Hz, in rad (m for slide "
        "joints): `time` and one column `<joint>/position_target` for each joint. All begin and "
        "end at rest at the start pose below.",
        "",
    ]
    told += [manner.tried, ""] if manner.tried else []
    told += [f"**{note[0].upper()}{note[1:]}.**\n" for note in notes]
    told += ["## Before", "", *(f"{k}. {line}" for k, line in enumerate(manner.safety, 1)), ""]
    told += ["## Order", "", "| file | what it tells |", "|---|---|"]
    told += [f"| `{file}` | {purpose} |" for file, purpose in files.items()]
    told += [
        "",
        "Look at each log before you send the next file: did every joint go where it was sent, and "
        "is every column there? Wait until the drives have cooled down.",
        "",
        *_limits_told(limits),
        *_log_told(limits, manner),
        "## Then",
        "",
        "```",
        f"walkerkit compare {model} recordings/*.parquet",
        f"walkerkit diagnose {model} recordings/*.parquet --out diagnosis",
        "```",
        "",
    ]
    return "\n".join(told)


def _limits_told(limits: Sequence[Limits]) -> Iterator[str]:
    """The lines on where each joint is sent."""
    yield from (
        "## Limits",
        "",
        "| joint | start | lowest | highest | fastest |",
        "|---|---|---|---|---|",
    )
    for one in limits:
        unit = "m" if one.slide else "rad"
        yield (
            f"| `{one.joint}` | {one.start:.3f} {unit} | {one.lower:.3f} | {one.upper:.3f} | "
            f"{one.speed:.2f} {unit}/s |"
        )
    yield ""


def _log_told(limits: Sequence[Limits], manner: Manner) -> tuple[str, ...]:
    """The lines on what to log."""
    return (
        "## Log",
        "",
        "One row for each turn of the control loop, of what the drive was told and what it "
        "measured, stamped by one clock:",
        "",
        "| column | unit | |",
        "|---|---|---|",
        *(f"| `{name}` | {unit} | {need} |" for name, unit, need in manner.columns),
        "",
        f"The joints are {', '.join(f'`{one.joint}`' for one in limits)}. Other names, units and "
        "formats (bags, JSON, NPZ, …) are read by `walkerkit import LOG --model MODEL --out "
        "recordings`.",
        "",
    )


_ALWAYS = (
    "One person holds the emergency stop. It cuts the motors' power and is no software.",
    "Let the motors warm up for a minute.",
    "Move slowly to the start pose, then begin.",
)
_JOINTS = (
    ("time", "s", "required"),
    ("<joint>/position_target", "rad", "required: what the drive was told, after all filters"),
    ("<joint>/position", "rad", "required: as the encoder measured it"),
    ("<joint>/effort", "N·m", "the drive's current times its torque constant, if it has it"),
    ("<joint>/velocity", "rad/s", "as the drive reports it, if it does"),
)

HUNG = Manner(
    safety=(
        "Hang the robot up, or fix its trunk, so that no foot reaches anything.",
        _ALWAYS[0],
        "Limit torque to a third and speed to a half in the drives, not in the script, and set "
        "their position limits inside of the mechanical ones. Tell the model that hangs of that "
        "torque (`walkerkit servo --effort`), and none that is to be trained with.",
        *_ALWAYS[1:],
        "Stop by ramping the targets back to the start pose, never by switching the gains off.",
    ),
    columns=_JOINTS,
)


def standing_manner(feet: Sequence[str], tried: str) -> Manner:
    """That of a robot on its feet.

    Args:
        feet: their names in the model.
        tried: how the targets were tried, a paragraph.
    """
    names = ", ".join(f"`{foot}`" for foot in feet)
    return Manner(
        safety=(
            "Hang a slack rope from above on the trunk: it carries nothing while the robot "
            "stands, and all of it when it falls. Level, dry ground, two metres of it all around.",
            _ALWAYS[0],
            "Run the hung experiments first (`walkerkit hang`, `walkerkit excite`), and mend the "
            "model by them: the targets are only as safe as the gains and the masses are right.",
            *_ALWAYS[1:],
            "Let it stand for a second before and after each file, and log that too.",
            "Stop by ramping the targets back to the start pose. Switching the gains off drops the "
            "robot.",
            "Skip what your robot does worse than the simulation: a foot that slips, a trunk that "
            "rings.",
        ),
        columns=(
            *_JOINTS,
            (
                "base/position_x … z, base/quaternion_w … z",
                "m; base to world",
                "motion capture, if there is one",
            ),
            (
                "base/imu_angular_velocity_x … z, base/imu_acceleration_x … z",
                "rad/s; m/s²",
                "required without motion capture: raw, in the unit's frame",
            ),
            ("base/imu_quaternion_w … z", "unit to world", "if the unit gives one"),
            ("<foot>/contact or <foot>/force", "0 or 1; any", f"if there are sensors: {names}"),
        ),
        tried=tried,
    )
