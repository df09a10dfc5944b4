"""The command line, thin over the API.

Exit status 0: finished, whatever the verdict; 2: the input is unusable, with one line that says
why; 1: our own failure; 130: interrupted; 141: whoever read the output is gone.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO

import typer

from walkerkit.gap.bar import bar_on_stderr, progress_bar, say, stages
from walkerkit.gap.errors import InputError
from walkerkit.gap.ingest.import_cli import app as ingest_commands
from walkerkit.gap.own_robot.own_robot_cli import app as own_robot_commands
from walkerkit.gap.policy.policy_cli import app as policy_commands
from walkerkit.gap.report.replay_cli import app as report_commands

if TYPE_CHECKING:
    from walkerkit.gap.search.effort import Effort

# dm_control looks for a display when it is imported, unless it is told that none is wanted.
os.environ.setdefault("MUJOCO_GL", "disable")

app = typer.Typer(
    name="walkerkit",
    help="Find where your robot and its simulation disagree, name why, and mend the model.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(ingest_commands)
app.add_typer(own_robot_commands)
app.add_typer(report_commands)
app.add_typer(policy_commands)
_OUR_FAILURE = 1
_INTERRUPTED, _CLOSED_PIPE = 130, 141  # as of processes that the signals end
_MOST_TOLD = 200  # characters of an error that is ours; the file has them all
# typer exports one kind of usage error, but not the class that all of them have in common.
_UsageError: type[typer.BadParameter] = typer.BadParameter.__mro__[1]

Model = Annotated[
    str,
    typer.Argument(help="MJCF file, package.module:callable, or a manifest experiments.toml."),
]
Recordings = Annotated[
    list[Path] | None,
    typer.Argument(help="CSV, Parquet or NPZ recordings of the robot, or logs as for `import`."),
]
HeldOut = Annotated[
    list[Path] | None,
    typer.Option(help="A recording that no fit may see. May be given several times."),
]
Skip = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[FILE=]START:STOP",
        help="Leave out a span of a recording, in seconds. May be given several times.",
    ),
]
Map = Annotated[
    Path | None,
    typer.Option("--map", help="How logs of other formats are read, as `import` writes it."),
]
Known = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT[:PLACE]",
        help="An effect, or a number such as mass:calf, that is right in the model: it is not "
        "changed. May be given several times.",
    ),
]
Doubt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT[:PLACE]",
        help="An effect or a number of whose size nothing is known: naming it costs nothing. May "
        "be given several times.",
    ),
]
EffortLevel = Annotated[
    str,
    typer.Option(
        metavar="quick|normal|thorough",
        help="How much is tried. Ctrl-C ends a search with what it has found.",
    ),
]
Explain = Annotated[
    bool,
    typer.Option("--explain", help="Print the table by which the structures were compared."),
]
Window = Annotated[
    float | None,
    typer.Option(
        help="Seconds between restarts where joints are driven by effort or the base floats; by "
        "default 0.5, of a robot that walks half as long as its feet stand and swing."
    ),
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
Traces = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="Also write measured and simulated signals: .parquet, .mcap or .rrd. May be repeated.",
    ),
]
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
    from walkerkit.gap.report.output import REPORT, check_folder

    check_folder(out)
    with progress_bar() as progress:
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
    _say_report(out / REPORT)


@app.command()
def compare(
    model: Model,
    recordings: Recordings = None,
    held_out: HeldOut = None,
    skip: Skip = None,
    column_map: Map = None,
    window: Window = None,
    threads: Threads = 0,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Json = False,
) -> None:
    """Measure the gap between a model and recordings, and say where it is."""
    from walkerkit.gap import workflow

    with progress_bar() as progress:
        progress("comparing", 0.0)
        diagnosis = workflow.compare(
            model,
            recordings or (),
            held_out=held_out or (),
            skip=skip or (),
            column_map=column_map,
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
    skip: Skip = None,
    column_map: Map = None,
    out: Out = Path("walkerkit-diagnosis"),
    window: Window = None,
    effect: Effects = None,
    known: Known = None,
    doubt: Doubt = None,
    effort: EffortLevel = "normal",
    traces: Traces = None,
    threads: Threads = 0,
    overwrite: Overwrite = False,
    allow_code: AllowCode = False,
    allow_outside: AllowOutside = False,
    json: Json = False,
    explain: Explain = False,
) -> None:
    """Find where simulation and recordings disagree, name why, and mend the model.

    The same command goes on where one that was killed had come to.
    """
    from walkerkit.gap import workflow
    from walkerkit.gap.report.output import REPORT, check_folder
    from walkerkit.gap.report.traces import check_traces, write_traces
    from walkerkit.gap.search.effort import Effort

    check_folder(out)
    for path in traces or ():
        check_traces(path)
    spending = Effort(effort)  # type: ignore[arg-type]
    with bar_on_stderr() as bar, _stopped_by_hand(spending, bar):
        result = workflow.diagnose(
            model,
            recordings or (),
            held_out=held_out or (),
            skip=skip or (),
            column_map=column_map,
            window=window,
            effects=effect,
            known=known or (),
            doubt=doubt or (),
            effort=spending,
            n_threads=threads,
            allow_code=allow_code,
            allow_outside=allow_outside,
            progress=stages(bar, lines=True),
            first=lambda answer: say(bar, answer.sentence),
            out=out,
            overwrite=overwrite,
        )
    for path in traces or ():
        write_traces(result.diagnosis.traces, path)
    _print_result(result, as_json=json)
    if explain:
        _explain(result)
    if not json:
        _say_report(out / REPORT)


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
    window: Window = None,
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
    from walkerkit.gap.fleet import fleet_console as words
    from walkerkit.gap.fleet.fleet import diagnose_fleet as diagnose_all

    console = _console(sys.stdout)
    # Ray says on standard output what happens to its workers.
    with redirect_stdout(sys.stderr), bar_on_stderr() as bar:
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
            ended=words.as_they_end(bar, console, lines=not json),
        )
    if json:
        typer.echo(fleet.to_json(), nl=False)
    else:
        console.print()
        console.print(words.render(fleet))
        _say_report(out / "fleet.html")
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
def apply(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a diagnosis.")],
    model: Annotated[Path, typer.Argument(help="Another MJCF file of the same robot.")],
    out: Annotated[Path, typer.Option(help="The MJCF file to write.")],
    effect: Annotated[
        list[str] | None, typer.Option(help="Apply only this effect. May be repeated.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files that are there.")
    ] = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Write what a diagnosis has found into another model of the robot.

    Only the attributes that it names change; every other byte of the file stays.
    What MJCF cannot say goes to actuators.json beside it.
    """
    from walkerkit.gap.deliver import apply as apply_to

    done = apply_to(
        folder,
        model,
        out=out,
        effects=effect or (),
        overwrite=overwrite,
        allow_outside=allow_outside,
    )
    console = _console()

    def say(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True, highlight=False)

    for line in done.changes or ("No attribute changes.",):
        say(line)
    if done.beside:
        say("MJCF cannot say the following, which is in actuators.json beside it:")
    for line in done.beside:
        say(f"  {line}")
    for note in done.notes:
        say(f"Note: {note}")
    for name, version in done.needs.items():
        say(f"Note: {name} takes MuJoCo {version} or newer.")
    for path in done.files:
        say(f"Written: {path}")


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a diagnosis.")],
    to: Annotated[str, typer.Option(help="mjlab, isaaclab, mjx or warp.")],
    model: Annotated[
        Path | None,
        typer.Option(
            help="Another MJCF file of the same robot, as the one that floats; by default the "
            "diagnosed one."
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Export only this effect, with --model. May be repeated."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; by default DIR/ and the trainer's name.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what is in the folder.")
    ] = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Write a diagnosis in the words of a trainer: model, configs, laws, ranges."""
    from walkerkit.gap.deliver import export as export_to

    done = export_to(
        folder,
        to,
        model=model,
        effects=effect or (),
        out=out,
        overwrite=overwrite,
        allow_outside=allow_outside,
    )
    console = _console()
    lines = [f"Written: {path}" for path in done.files]
    lines += [f"Lost: {line}" for line in done.lost]
    for line in [*lines, *(f"Note: {note}" for note in done.notes)]:
        console.print(line, markup=False, soft_wrap=True, highlight=False)


@app.command()
def effects() -> None:
    """List the catalogue of effects."""
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    from walkerkit.gap.effects import CATALOGUE
    from walkerkit.gap.report.console import Paragraph

    console = _console()
    for effect in CATALOGUE.values():
        table = Table.grid(padding=(0, 1))
        said = {"law": effect.equation, "shows as": effect.symptom, "added as": effect.added_as}
        for name, text in said.items():
            table.add_row(Text(name, style="dim"), Paragraph(text))
        console.print(Text(effect.name, style="bold"))
        console.print(Padding(table, (0, 0, 0, 2), expand=False))
        console.print()


@app.command()
def simulate(
    model: Annotated[
        str,
        typer.Argument(
            help="MJCF file or package.module:callable, of a robot with servos or motors."
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

    Position servos are sent positions. Beside motors and velocity servos
    a computer goes for the positions, and what it sends is logged.
    Any effect but timestep can be hidden, which is no robot's;
    ground_friction, ground_compliance and foot_offset where a robot floats,
    with spheres for feet and a level plane.
    """
    from walkerkit.gap.rehearsal.rehearse import EXPERIMENTS, rehearse
    from walkerkit.gap.report.output import check_folder, check_free, write_folder

    hide = _to_hide(model, hide, more)
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


def _to_hide(model: str, hide: list[str] | None, more: list[str] | None) -> list[str] | None:
    """The effects to hide, or None; what was given in the wrong place is refused."""
    from walkerkit.gap.effects import CATALOGUE

    if model in CATALOGUE and not Path(model).exists():
        raise InputError(f"{model!r} is an effect, and no model: the model comes before --hide.")
    if more and not hide:
        raise InputError(
            f"{more[0]!r} follows the model {model!r}; effects to hide come after --hide."
        )
    return [*hide, *(more or ())] if hide else None


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
    except Exception as error:  # whatever it is, it is ours
        _admit(error)
        status = _OUR_FAILURE
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


def _admit(error: Exception) -> None:
    """Says in one line that this is a failure of ours, and which file tells more of it."""
    from walkerkit.gap.errors import one_line
    from walkerkit.gap.failure import report

    path = report(error, sys.argv[1:])
    more = "" if path is None else f" Please send us {path}, which has the details."
    typer.echo(
        f"walkerkit: this is a failure of ours: {type(error).__name__}: "
        f"{one_line(error)[:_MOST_TOLD]}.{more}",
        err=True,
    )


def _console(file: TextIO | None = None) -> Any:
    from rich.console import Console

    return Console(file=file)


@contextmanager
def _stopped_by_hand(effort: Effort, bar: Any) -> Iterator[None]:
    """Has a first Ctrl-C end a search with what it has found, and a second one end the program."""

    def stop(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        effort.stop()
        say(bar, "Stopping with what was found so far. Ctrl-C again ends without it.")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _explain(result: Any) -> None:
    """Prints the most probable structures on standard error, so that --json stays JSON."""
    from walkerkit.gap.report.console import comparison_table

    _console(sys.stderr).print(comparison_table(result.comparison))


def _say_report(path: Path) -> None:
    """The last line is where the report is, and nothing else, whole."""
    _console().print(str(path), markup=False, soft_wrap=True, highlight=False)


def _print_result(result: Any, *, as_json: bool) -> None:
    _print_diagnosis(result.diagnosis, as_json=as_json)


def _print_diagnosis(diagnosis: Any, *, as_json: bool) -> None:
    if as_json:
        typer.echo(diagnosis.to_json(), nl=False)
        return
    from walkerkit.gap.report.console import render

    _console().print(render(diagnosis))
