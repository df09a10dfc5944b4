"""The command line, thin over the API.

Exit status 0: finished, whatever the verdict; 2: the input is unusable, with one line that says
why; 1: our own failure; 130: interrupted; 141: whoever read the output is gone.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO

import typer

from walkerkit.gap.errors import InputError

if TYPE_CHECKING:
    from walkerkit.gap.search.fit import Progress

# dm_control looks for a display when it is imported, unless it is told that none is wanted.
os.environ.setdefault("MUJOCO_GL", "disable")

app = typer.Typer(
    name="walkerkit",
    help="Find where your robot and its simulation disagree, name why, and mend the model.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
_INTERRUPTED, _CLOSED_PIPE = 130, 141  # as of processes that the signals end
# typer exports one kind of usage error, but not the class that all of them have in common.
_UsageError: type[typer.BadParameter] = typer.BadParameter.__mro__[1]

Model = Annotated[
    str,
    typer.Argument(help="MJCF file, package.module:callable, or a manifest experiments.toml."),
]
Recordings = Annotated[
    list[Path] | None, typer.Argument(help="CSV, Parquet or NPZ recordings of the robot.")
]
HeldOut = Annotated[
    list[Path] | None,
    typer.Option(help="A recording that no fit may see. May be given several times."),
]
Window = Annotated[
    float,
    typer.Option(help="Seconds between restarts where joints are driven by effort."),
]
Threads = Annotated[
    int, typer.Option(min=0, help="Threads and processes of the simulation, 0 for all cores.")
]
Effects = Annotated[
    list[str] | None, typer.Option(help="Consider only this effect. May be repeated.")
]
AllowCode = Annotated[
    bool,
    typer.Option("--allow-code", help="Run a package.module:callable that a manifest names."),
]
AllowOutside = Annotated[
    bool,
    typer.Option(
        "--allow-outside", help="Let a model read files outside of its folder (meshes, includes)."
    ),
]
Out = Annotated[Path, typer.Option(help="Folder for the report, the mended model and the JSON.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace what another run has left in the folder.")
]
Json = Annotated[bool, typer.Option("--json", help="Print diagnosis.json instead of tables.")]


def _tell_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"walkerkit {version('walkerkit')}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_tell_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """What all commands have in common."""


@app.command()
def demo(
    seed: Annotated[int, typer.Option(min=0, help="What is hidden, where and how large.")] = 0,
    hide: Annotated[
        list[str] | None, typer.Option(help="Hide this effect instead of a drawn one; or none.")
    ] = None,
    out: Out = Path("walkerkit-demo"),
    threads: Threads = 0,
    overwrite: Overwrite = False,
) -> None:
    """Hide an effect in a simulated leg, record it, and find it again."""
    from walkerkit.gap.rehearsal.demo import run
    from walkerkit.gap.report.output import check_folder

    check_folder(out)
    with _progress() as progress:
        result, rehearsal = run(
            seed=seed,
            hide=hide,
            out=out,
            n_threads=threads,
            progress=progress,
            overwrite=overwrite,
        )
    _print_result(result, as_json=False)
    console = _console()
    hidden = [effect.describe() for effect in rehearsal.hidden] or ["nothing"]
    console.print(f"What was hidden: {'; '.join(hidden)}", markup=False, soft_wrap=True)
    console.print(f"Look at {out / 'report.html'}", markup=False, soft_wrap=True)


@app.command()
def compare(
    model: Model,
    recordings: Recordings = None,
    held_out: HeldOut = None,
    window: Window = 0.5,
    threads: Threads = 0,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Json = False,
) -> None:
    """Measure the gap between a model and recordings, and say where it is."""
    from walkerkit.gap import workflow

    with _progress() as progress:
        progress("comparing", 0.0)
        diagnosis = workflow.compare(
            model,
            recordings or (),
            held_out=held_out or (),
            window=window,
            n_threads=threads,
            allow_code=allow_code,
            allow_outside=allow_outside,
        )
    _print_diagnosis(diagnosis, as_json=json)


@app.command()
def diagnose(
    model: Model,
    recordings: Recordings = None,
    held_out: HeldOut = None,
    out: Out = Path("walkerkit-diagnosis"),
    window: Window = 0.5,
    effect: Effects = None,
    threads: Threads = 0,
    overwrite: Overwrite = False,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Json = False,
) -> None:
    """Find where simulation and recordings disagree, name why, and mend the model.

    The same command goes on where one that was killed had come to.
    """
    from walkerkit.gap import workflow
    from walkerkit.gap.report.output import check_folder

    check_folder(out)
    with _progress() as progress:
        result = workflow.diagnose(
            model,
            recordings or (),
            held_out=held_out or (),
            window=window,
            effects=effect,
            n_threads=threads,
            allow_code=allow_code,
            allow_outside=allow_outside,
            progress=progress,
            out=out,
            overwrite=overwrite,
        )
    _print_result(result, as_json=json)
    if not json:
        _console().print(f"Written to {out}", markup=False, soft_wrap=True)


@app.command()
def diagnose_fleet(
    manifest: Annotated[Path, typer.Argument(help="fleet.toml, which lists the robots.")],
    out: Annotated[Path, typer.Option(help="Folder for all robots; each gets one in it.")] = Path(
        "walkerkit-fleet"
    ),
    engine: Annotated[
        str, typer.Option(help="What runs the diagnoses: processes, ray or dask.")
    ] = "processes",
    address: Annotated[
        str | None, typer.Option(help="Of a Ray or Dask cluster; one is started by default.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Robots at a time, by default one for each core.")
    ] = None,
    window: Window = 0.5,
    effect: Effects = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of each simulation.")] = 1,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite",
            help="Diagnose again what DIR has of the same input, and replace what no fleet left.",
        ),
    ] = False,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Annotated[bool, typer.Option("--json", help="Print fleet.json instead of tables.")] = (
        False
    ),
) -> None:
    """Diagnose many robots side by side and compare them."""
    from walkerkit.gap.fleet import console as words
    from walkerkit.gap.fleet.fleet import diagnose_fleet as diagnose_all

    console = _console(sys.stdout)
    # Ray says on standard output what happens to its workers.
    with redirect_stdout(sys.stderr), _bar() as bar:
        progress = _stages(bar)
        progress("diagnosing", 0.0)
        lines = bar.console if bar.console.is_terminal else console  # above the bar

        def ended(outcome: Any, number: int, total: int) -> None:
            progress(f"{number} of {total} robots", number / total)
            if not json:
                lines.print(words.line(outcome, number, total), soft_wrap=True)

        fleet = diagnose_all(
            manifest,
            out,
            engine=engine,
            address=address,
            workers=workers,
            window=window,
            effects=effect,
            n_threads=threads,
            allow_code=allow_code,
            allow_outside=allow_outside,
            overwrite=overwrite,
            ended=ended,
        )
    if json:
        typer.echo(fleet.to_json(), nl=False)
    else:
        console.print()
        console.print(words.render(fleet))
        console.print(f"Look at {out / 'fleet.html'}", markup=False, soft_wrap=True)
    if fleet.failed:
        _end_with_failures(fleet, manifest)


def _end_with_failures(fleet: Any, manifest: Path) -> NoReturn:
    """Says in one line what failed; the status is 2 where all of it is the input's."""
    first, *others = fleet.failed
    more = f" (and {len(others)} more, see above)" if others else ""
    remedy = "Mend it and run" if first.failure.refused else "See its failure.txt, or run"
    typer.echo(
        f"walkerkit: {manifest}: robot {first.robot!r} failed: "
        f"{first.failure.message.rstrip('.')}{more}. "
        f"{remedy} the same again: the other robots are kept.",
        err=True,
    )
    raise typer.Exit(2 if all(one.failure.refused for one in fleet.failed) else 1)


@app.command()
def effects() -> None:
    """List the catalogue of effects."""
    from rich.table import Column, Table

    from walkerkit.gap.effects import CATALOGUE

    table = Table(
        Column("effect", no_wrap=True), "equation", "where its residual shows", "added as"
    )
    for effect in CATALOGUE.values():
        table.add_row(effect.name, effect.equation, effect.symptom, effect.added_as)
    _console().print(table)


@app.command()
def simulate(
    model: Annotated[
        str,
        typer.Argument(
            help="MJCF file or package.module:callable, of a robot with position actuators."
        ),
    ],
    more: Annotated[
        list[str] | None,
        typer.Argument(metavar="EFFECT", help="More effects, after that of --hide."),
    ] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT [EFFECT]...",
            help="Effects to hide, or none. May be repeated; one is drawn by default.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sizes, the motions, the noise.")] = 0,
    seconds: Annotated[float, typer.Option(help="Length of each experiment.")] = 10.0,
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("rehearsal"),
    imu: Annotated[
        bool,
        typer.Option(
            "--imu", help="Of a base that floats, an inertial unit's readings, not its pose."
        ),
    ] = False,
    overwrite: Overwrite = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Rehearse: record simulated hardware with effects hidden in it.

    Each actuator has to be a position servo, as positions are what is sent:
    a robot that takes efforts or speeds cannot be rehearsed.
    Any effect but timestep can be hidden, which is no robot's;
    ground_friction, ground_compliance and foot_offset where a robot floats,
    with spheres for feet and a level plane.
    """
    from walkerkit.gap.effects import CATALOGUE
    from walkerkit.gap.rehearsal.rehearse import EXPERIMENTS, rehearse
    from walkerkit.gap.report.output import check_folder, check_free, write_folder

    if model in CATALOGUE and not Path(model).exists():
        raise InputError(f"{model!r} is an effect, and no model: the model comes before --hide.")
    if more and not hide:
        raise InputError(
            f"{more[0]!r} follows the model {model!r}; effects to hide come after --hide."
        )
    hide = [*hide, *(more or ())] if hide else None
    check_folder(out)
    files = {name: f"{name}.csv" for name in EXPERIMENTS}
    check_free(out, files.values(), kind="rehearsal", overwrite=overwrite)
    rehearsal = rehearse(
        model, hide, seed=seed, seconds=seconds, allow_outside=allow_outside, imu=imu
    )

    def write(made: Path) -> None:
        for recording in rehearsal.recordings:
            recording.save(made / files[recording.name])

    write_folder(out, write, run={"kind": "rehearsal"}, overwrite=overwrite)
    console = _console()
    for file in files.values():
        console.print(str(out / file), markup=False, soft_wrap=True)
    hidden = [effect.describe() for effect in rehearsal.hidden] or ["nothing"]
    console.print(f"hidden: {'; '.join(hidden)}", markup=False, soft_wrap=True)


def main() -> None:
    """Runs the program and ends the process with its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not every terminal can write τ and µ
            stream.reconfigure(errors="replace")
    try:
        status = app(sys.argv[1:] or ["--help"], prog_name=app.info.name, standalone_mode=False)
    except InputError as error:
        _refuse(str(error))
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else app.info.name
        _refuse(f"{error.format_message().rstrip('.')}. See `{command} --help`.")
    except (KeyboardInterrupt, typer.Abort):
        status = _INTERRUPTED
    except (BrokenPipeError, SystemExit):  # rich and typer end the process of a closed pipe so
        status = _CLOSED_PIPE
    if status == _INTERRUPTED:
        typer.echo("walkerkit: interrupted. The same command goes on from there.", err=True)
    try:
        if sys.stdout is not None:  # closed from the start
            sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = _CLOSED_PIPE
    sys.exit(status)


def _refuse(message: str) -> NoReturn:
    typer.echo(f"walkerkit: {' '.join(message.split())}", err=True)
    raise SystemExit(2) from None


def _console(file: TextIO | None = None) -> Any:
    from rich.console import Console

    return Console(file=file)


@contextmanager
def _bar() -> Iterator[Any]:
    """A progress bar on standard error where that is a terminal, and silence where it is not."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield bar


def _stages(bar: Any) -> Progress:
    """Has a bar show what is being done and how far it is."""
    task = bar.add_task("starting", total=1.0)
    return lambda stage, done: bar.update(task, description=stage, completed=done)


@contextmanager
def _progress() -> Iterator[Progress]:
    """The bar for one piece of work."""
    with _bar() as bar:
        yield _stages(bar)


def _print_result(result: Any, *, as_json: bool) -> None:
    _print_diagnosis(result.diagnosis, as_json=as_json)


def _print_diagnosis(diagnosis: Any, *, as_json: bool) -> None:
    if as_json:
        typer.echo(diagnosis.to_json(), nl=False)
        return
    from walkerkit.gap.report.console import render

    _console().print(render(diagnosis))
