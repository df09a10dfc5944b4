"""The command line, thin over the API.

Exit status 0: finished, whatever the verdict; 2: the input is unusable, with one line that says
why; 1: our own failure.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

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
Threads = Annotated[int, typer.Option(min=0, help="Threads of the simulation, 0 for all cores.")]
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
Json = Annotated[bool, typer.Option("--json", help="Print diagnosis.json instead of tables.")]


@app.command()
def demo(
    seed: Annotated[int, typer.Option(min=0, help="What is hidden, where and how large.")] = 0,
    hide: Annotated[
        list[str] | None, typer.Option(help="Hide this effect instead of a drawn one; or none.")
    ] = None,
    out: Out = Path("walkerkit-demo"),
    threads: Threads = 0,
) -> None:
    """Hide an effect in a simulated leg, record it, and find it again."""
    from walkerkit.gap.rehearsal.demo import run
    from walkerkit.gap.report.output import check_folder

    check_folder(out)
    with _progress() as progress:
        result, rehearsal = run(seed=seed, hide=hide, out=out, n_threads=threads, progress=progress)
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
    effect: Annotated[
        list[str] | None, typer.Option(help="Consider only this effect. May be repeated.")
    ] = None,
    threads: Threads = 0,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Json = False,
) -> None:
    """Find where simulation and recordings disagree, name why, and mend the model."""
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
        )
        result.save(out)
    _print_result(result, as_json=json)
    if not json:
        _console().print(f"Written to {out}", markup=False, soft_wrap=True)


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
    model: Annotated[str, typer.Argument(help="MJCF file of a robot with position actuators.")],
    hide: Annotated[
        list[str] | None,
        typer.Option(help="Effect to hide, or none. May be repeated; one is drawn by default."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sizes, the motions, the noise.")] = 0,
    seconds: Annotated[float, typer.Option(help="Length of each experiment.")] = 10.0,
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("rehearsal"),
) -> None:
    """Rehearse: record simulated hardware with effects hidden in it."""
    from walkerkit.gap.rehearsal.rehearse import rehearse

    rehearsal = rehearse(model, hide, seed=seed, seconds=seconds)
    console = _console()
    try:
        out.mkdir(parents=True, exist_ok=True)
        for recording in rehearsal.recordings:
            recording.save(out / f"{recording.name}.csv")
            console.print(str(out / f"{recording.name}.csv"), markup=False, soft_wrap=True)
    except OSError as error:
        raise InputError(
            f"{out}: cannot be written ({error.strerror}). Give another folder with --out."
        ) from None
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
    sys.exit(status)


def _refuse(message: str) -> NoReturn:
    typer.echo(f"walkerkit: {' '.join(message.split())}", err=True)
    raise SystemExit(2) from None


def _console() -> Any:
    from rich.console import Console

    return Console()


@contextmanager
def _progress() -> Iterator[Progress]:
    """A progress bar on standard error where that is a terminal, and silence where it is not."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def _print_result(result: Any, *, as_json: bool) -> None:
    _print_diagnosis(result.diagnosis, as_json=as_json)


def _print_diagnosis(diagnosis: Any, *, as_json: bool) -> None:
    if as_json:
        typer.echo(diagnosis.to_json(), nl=False)
        return
    from walkerkit.gap.report.console import render

    _console().print(render(diagnosis))
