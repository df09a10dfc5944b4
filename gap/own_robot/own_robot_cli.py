"""`walkerkit servo`, `walkerkit hang` and `walkerkit excite`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from walkerkit.gap.own_robot.excite import Battery

app = typer.Typer()

_EXCITATION = "excitation"

Model = Annotated[str, typer.Argument(help="MJCF file.")]
Out = Annotated[Path, typer.Option(help="The new MJCF file, beside the old one.")]
Joints = Annotated[
    list[str] | None,
    typer.Option(help="Regular expression of the whole name of joints. May be repeated."),
]
Replace = Annotated[bool, typer.Option("--overwrite", help="Replace the file if it is there.")]
AllowOutside = Annotated[
    bool,
    typer.Option("--allow-outside", help="Let the model read files outside of its folder."),
]


@app.command()
def servo(
    model: Model,
    kp: Annotated[float, typer.Option(help="Stiffness, N·m/rad.")],
    kd: Annotated[float, typer.Option(help="Damping, N·m·s/rad.")],
    out: Out,
    joint: Joints = None,
    effort: Annotated[
        float | None, typer.Option(help="The drives' limit, N·m; by default the motors'.")
    ] = None,
    overwrite: Replace = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Turn torque motors into the servo that the robot's controller is.

    With gains that differ from joint to joint, give the command once for each,
    with --joint, and the last one's file.
    """
    from walkerkit.gap.own_robot.servo import with_servos
    from walkerkit.gap.simulation.load_robot import load_robot

    made = with_servos(
        model, kp=kp, kd=kd, joints=joint or (), effort=effort, allow_outside=allow_outside
    )
    _check_free(out, overwrite)
    written = made.text.write(out)
    robot = load_robot(out, allow_outside=allow_outside)
    for name in made.joints:
        drive = robot.joints[name].drive("position")
        if drive is None or not _same(drive.stiffness, kp) or not _same(drive.damping, kd):
            raise RuntimeError(f"{out}: joint {name!r} did not become a servo of these gains")
    typer.echo(made.snippet)
    _tell(made.notes, written)


@app.command()
def hang(
    model: Model,
    out: Out,
    height: Annotated[
        float | None, typer.Option(help="Of the trunk, m; by default clear of the ground.")
    ] = None,
    overwrite: Replace = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Hang a robot that floats up by its trunk, for experiments on its joints."""
    from walkerkit.gap.own_robot.hang import hung
    from walkerkit.gap.simulation.load_robot import load_robot

    made = hung(model, height=height, allow_outside=allow_outside)
    _check_free(out, overwrite)
    written = made.text.write(out)
    if load_robot(out, allow_outside=allow_outside).base is not None:
        raise RuntimeError(f"{out}: the robot still floats")
    notes = [f"{made.body!r} is fixed to the world at {made.height:g} m"]
    if made.excluded:
        pairs = ", ".join(f"{a}–{b}" for a, b in made.excluded)
        notes.append(f"no longer collide, as neighbours do not while it floats: {pairs}")
    _tell(notes, written)


@app.command()
def excite(
    model: Annotated[str, typer.Argument(help="MJCF file or package.module:callable.")],
    out: Annotated[Path, typer.Option(help="Folder for the targets and their README.md.")] = Path(
        "targets"
    ),
    joint: Joints = None,
    seconds: Annotated[float, typer.Option(help="Length of each file.")] = 12.0,
    rate: Annotated[float, typer.Option(help="Samples a second.")] = 500.0,
    share: Annotated[float, typer.Option(help="Of a third of each joint's range, up to 1.")] = 1.0,
    speed: Annotated[
        float | None,
        typer.Option(help="Of the fastest target, rad/s or m/s; 4, and 10 with --standing."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of phases and levels.")] = 0,
    standing: Annotated[
        bool,
        typer.Option("--standing", help="For a robot on its feet: motions tried in simulation."),
    ] = False,
    threads: Annotated[
        int, typer.Option(min=0, help="Threads of the simulation, 0 for all cores.")
    ] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what another run has left in the folder.")
    ] = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Write targets that make missing effects show, and how to send them safely."""
    from walkerkit.gap.recordings.files import write as write_columns
    from walkerkit.gap.report.output import check_folder, write_folder

    check_folder(out)
    numbers = {"seconds": seconds, "rate": rate, "share": share}
    if speed is not None:
        numbers["speed"] = speed
    if standing:
        battery = _standing(model, joint, allow_outside, threads, seed, numbers)
    else:
        battery = _hung(model, joint, allow_outside, seed, numbers)

    def write(made: Path) -> None:
        for name, columns in battery.files.items():
            write_columns(made / name, columns)
        (made / "README.md").write_text(battery.readme, encoding="utf-8")

    write_folder(out, write, run={"kind": _EXCITATION}, overwrite=overwrite)
    for name in battery.files:
        typer.echo(str(out / name))
    _tell([*battery.notes, f"read {out / 'README.md'} before you send them"], ())


def _hung(
    model: str,
    joints: list[str] | None,
    allow_outside: bool,
    seed: int,
    numbers: Mapping[str, float],
) -> Battery:
    from walkerkit.gap.own_robot.excite import targets_for
    from walkerkit.gap.simulation.load_robot import load_robot

    robot = load_robot(model, allow_outside=allow_outside)
    return targets_for(robot, joints=joints or (), seed=seed, **numbers)


def _standing(
    model: str,
    joints: list[str] | None,
    allow_outside: bool,
    threads: int,
    seed: int,
    numbers: Mapping[str, float],
) -> Battery:
    from walkerkit.gap.bar import progress_bar
    from walkerkit.gap.errors import refusal
    from walkerkit.gap.own_robot.excite_standing import standing_targets_for
    from walkerkit.gap.simulation.load_robot import load_robot

    if joints:
        raise refusal(
            f"--joint {joints[0]!r}: a robot on its feet moves all of its joints. Leave out "
            "--joint or --standing."
        )
    robot = load_robot(model, floating=True, allow_outside=allow_outside)
    with progress_bar(lines=True) as progress:
        return standing_targets_for(
            robot, seed=seed, n_threads=threads, progress=progress, **numbers
        )


def _check_free(path: Path, overwrite: bool) -> None:
    from walkerkit.gap.errors import refusal

    if path.exists() and not overwrite:
        raise refusal(f"{path}: is there already. Give another --out, or --overwrite.")


def _same(found: float, wanted: float) -> bool:
    return abs(found - wanted) <= 1e-6 * max(1.0, abs(wanted))


def _tell(notes: Iterable[str], written: Iterable[Path]) -> None:
    for note in notes:
        typer.echo(f"note: {note}")
    for path in written:
        typer.echo(f"Written to {path}")
