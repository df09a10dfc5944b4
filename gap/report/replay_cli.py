"""`walkerkit replay`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from walkerkit.gap.errors import InputError, closest

app = typer.Typer()

_BACKENDS = ("egl", "osmesa")  # that need no display
_OFF = ("disable", "disabled", "off", "false", "0")  # of MUJOCO_GL
_TRY = (
    "import mujoco; model = mujoco.MjModel.from_xml_string('<mujoco/>'); "
    "mujoco.Renderer(model, 8, 8).close()"
)
_EXTRA = "pip install 'walkerkit[video]'"
_ENDING = ".mp4"


@app.command()
def replay(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a diagnosis.")],
    out: Annotated[Path, typer.Option(help="The mp4 to write.")],
    recording: Annotated[
        str | None, typer.Option(help="Of which recording; by default the first held-out one.")
    ] = None,
    magnify: Annotated[
        float, typer.Option(min=0, help="How many times as large as they are errors are drawn.")
    ] = 1.0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the file if it is there.")
    ] = False,
    allow_outside: Annotated[
        bool,
        typer.Option("--allow-outside", help="Let the model read files outside of its folder."),
    ] = False,
) -> None:
    """Film the robot: measured as a ghost over simulated, as given and mended.

    It is the part of a recording where the model as given is furthest off,
    10 s at most, as in the report.
    """
    from walkerkit.gap.report.motion import load_motions

    if out.suffix != _ENDING:
        raise InputError(f"{out}: videos are written as {_ENDING}. Give a file that ends so.")
    if out.exists() and not overwrite:
        raise InputError(f"{out}: is there. Give another file, or replace it with --overwrite.")
    motions = load_motions(folder, allow_outside=allow_outside)
    names = [motion.recording for motion in motions]
    if recording is not None and recording not in names:
        known = closest(recording, names) or f"; it has {', '.join(map(repr, names))}"
        raise InputError(f"{folder}: no recording {recording!r}{known}.")
    which = 0 if recording is None else names.index(recording)
    _check_video(out)
    wanted = {
        "folder": str(folder),
        "motion": which,
        "out": str(out),
        "factor": magnify,
        "allow_outside": allow_outside,
    }
    backend = rendering()
    out.parent.mkdir(parents=True, exist_ok=True)
    done = _python(["-m", "walkerkit.gap.report.film", json.dumps(wanted)], backend)
    if done.returncode:
        raise RuntimeError(f"the film ended with {done.returncode}: {_last(done)}")
    motion = motions[which]
    mended = ", as mended in blue on the right" if motion.mended else ""
    typer.echo(
        f"{motion.recording}, {motion.time[0]:.1f} to {motion.time[-1]:.1f} s: the model as given "
        f"in orange{mended}, measured as a ghost."
    )
    typer.echo(str(out))


def rendering() -> str:
    """What MuJoCo can render with here, a value of MUJOCO_GL.

    Raises:
        InputError: nothing does.
    """
    own = os.environ.get("MUJOCO_GL", "").lower().strip()
    backends = _BACKENDS if own in ("", *_OFF) else (own,)
    if os.environ.get("DISPLAY") and "glfw" not in backends:
        backends = (*backends, "glfw")
    said = []
    for backend in backends:
        done = _python(["-c", _TRY], backend)
        if not done.returncode:
            return backend
        said.append(f"{backend}: {_last(done)}")
    raise InputError(
        f"MuJoCo renders with nothing that is here ({'; '.join(said)}). Install a driver (Debian: "
        "`apt install libosmesa6`) and give the same command again, or copy the folder to a "
        "machine with a display."
    )


def _check_video(out: Path) -> None:
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError:
        raise InputError(f"{out}: what writes videos is not installed. Do `{_EXTRA}`.") from None


def _python(arguments: list[str], backend: str) -> subprocess.CompletedProcess[str]:
    """Runs Python where MuJoCo renders with something else than here."""
    environment = {**os.environ, "MUJOCO_GL": backend}
    environment.pop("PYOPENGL_PLATFORM", None)  # dm_control's choice, not MuJoCo's
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False
    )


def _last(done: subprocess.CompletedProcess[str]) -> str:
    """The last line of what a program said, or how it ended."""
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"ended with {done.returncode}"
