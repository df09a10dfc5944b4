"""`walkerkit import`: a log of any format, as recordings of ours and the map that made them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from walkerkit.gap.ingest.importing import Imported

app = typer.Typer()

_KIND, _MAP = "import", "map.toml"


@app.command(name="import")
def import_(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Bags (a folder, .mcap, .db3), LeRobot data sets, .csv, .parquet, .jsonl, .json, "
            ".npz, .npy, .pt.",
        ),
    ],
    model: Annotated[str, typer.Option(help="MJCF file or package.module:callable.")],
    out: Annotated[Path, typer.Option(help="Folder for the recordings and map.toml.")],
    column_map: Annotated[
        Path | None,
        typer.Option("--map", help="How the log is read; what it does not say is guessed."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Of a LeRobot robot, the file of lerobot-calibrate.")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV instead of Parquet.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what another run has left in the folder.")
    ] = False,
    allow_outside: Annotated[
        bool,
        typer.Option("--allow-outside", help="Let a model read files outside of its folder."),
    ] = False,
) -> None:
    """Turn a log of any format into recordings, and say how it was read.

    The folder gets one recording for each log, or for each episode of a data set,
    and map.toml: correct what is wrong there, and give it back with --map.
    """
    from walkerkit.gap.ingest.column_map import ColumnMap
    from walkerkit.gap.ingest.importing import import_log
    from walkerkit.gap.report.output import check_folder, write_folder
    from walkerkit.gap.simulation.load_robot import load_robot

    check_folder(out)
    given = None if column_map is None else ColumnMap.load(column_map)
    robot = load_robot(model, allow_outside=allow_outside)
    imported: list[Imported] = []
    for log in logs:
        known = imported[0].map if imported else given
        imported.append(import_log(log, robot, known, calibration=calibration))
    suffix = ".csv" if csv else ".parquet"
    _check_names(imported, suffix)

    def write(made: Path) -> None:
        for one in imported:
            for recording in one.recordings:
                recording.save(made / f"{recording.name}{suffix}")
        (made / _MAP).write_text(imported[0].map.to_toml(), encoding="utf-8")

    write_folder(out, write, run={"kind": _KIND}, overwrite=overwrite)
    _tell(imported, out, suffix)


def _check_names(imported: list[Imported], suffix: str) -> None:
    """Raises InputError where two recordings would be one file."""
    from walkerkit.gap.errors import refusal

    names: set[str] = set()
    for one in imported:
        for recording in one.recordings:
            name = f"{recording.name}{suffix}"
            if name in names:
                raise refusal(
                    f"{recording.source}: another log becomes {name} too. Import them one by one, "
                    "each into a folder of its own."
                )
            names.add(name)


def _tell(imported: list[Imported], out: Path, suffix: str) -> None:
    """Prints what was done, and the map last, to be read and corrected."""
    for one in imported:
        for recording in one.recordings:
            typer.echo(
                f"{out / recording.name}{suffix}: {len(recording.joints)} joints, "
                f"{recording.duration:.4g} s at {recording.rate:.4g} Hz"
            )
            for note in recording.notes:
                typer.echo(f"  {note}")
            if recording.unused:
                typer.echo(f"  {len(recording.unused)} columns of the log are not used")
    typer.echo(f"\n{out / _MAP}:\n")
    typer.echo(imported[0].map.to_toml(), nl=False)
