"""`walkerkit replay`: a video of the right length, or one line that says what is missing."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from walkerkit.gap import cli
from walkerkit.gap.errors import InputError
from walkerkit.gap.report import replay_cli
from walkerkit.gap.report.film import HEIGHT, WIDTH
from walkerkit.gap.report.motion import WHICH, Motion, save_motions
from walkerkit.gap.simulation.load_robot import load_robot

Program = Callable[..., tuple[int, str, str]]
FRAMES = 7
PENDULUM = """
<mujoco model="pendulum"><worldbody><geom type="plane" size="1 1 .1"/>
  <body name="arm" pos="0 0 0.5"><joint name="swing" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/></body></worldbody>
  <actuator><position joint="swing" kp="30"/></actuator></mujoco>
"""


@pytest.fixture
def driver() -> str:
    """What MuJoCo can render with here."""
    pytest.importorskip("imageio_ffmpeg")
    try:
        return replay_cli.rendering()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What a diagnosis of a pendulum leaves, as far as a film needs it."""
    path = tmp_path / "found" / "model.xml"
    path.parent.mkdir()
    path.write_text(PENDULUM)
    time = np.arange(FRAMES) / 25
    swing = np.sin(4 * time)[:, None]
    off = {"measured": 0.0, "before": 0.5, "after": 0.02}
    motion = Motion(
        recording="steps",
        held_out=True,
        robot=0,
        model=load_robot(path).model,
        time=time,
        joints=("swing",),
        addresses=(0,),
        **{which: swing + off[which] for which in WHICH},
    )
    gone = np.where(time[:, None] > 0.1, np.nan, motion.before)
    lost = replace(motion, recording="lost", before=gone, after=gone)  # nothing was mended
    save_motions([motion, lost], ["model.xml"], path.parent / "motions.npz")
    return path.parent


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["walkerkit", "replay", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        captured = capsys.readouterr()
        return int(ended.value.code or 0), captured.out, captured.err

    return run


def read(path: Path, width: int = 2 * WIDTH) -> np.ndarray:
    """(frames, height, width, 3) of a video."""
    from imageio_ffmpeg import get_ffmpeg_exe

    command = [get_ffmpeg_exe(), "-i", str(path), *("-f", "rawvideo", "-pix_fmt", "rgb24", "-")]
    done = subprocess.run(command, capture_output=True, check=True)
    return np.frombuffer(done.stdout, np.uint8).reshape(-1, HEIGHT, width, 3)


def test_every_frame_is_filmed_and_the_robot_moves(
    program: Program, folder: Path, driver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", driver)
    out = folder.parent / "new" / "x.mp4"
    status, said, error = program(folder, "--out", out)
    assert (status, error) == (0, "")
    assert said.splitlines()[-1] == str(out)
    frames = read(out).astype(int)
    assert frames.shape == (FRAMES, HEIGHT, 2 * WIDTH, 3)
    assert (np.abs(frames[-1] - frames[0]).max(axis=2) > 60).sum() > 500
    left, right = np.split(frames[0], 2, axis=1)
    assert (left[..., 0] - left[..., 2] > 40).sum() > 200  # orange
    assert (right[..., 2] - right[..., 0] > 20).sum() > 200  # blue
    assert program(folder, "--out", out)[0] == 2
    alone = folder.parent / "alone.mp4"
    assert program(folder, "--out", alone, "--recording", "lost", "--magnify", 3)[0] == 0
    assert read(alone, WIDTH).shape == (FRAMES, HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["found", "--out", "x.avi"], "x.avi: videos are written as .mp4"),
        (["found", "--out", "x.mp4", "--recording", "step"], "(did you mean 'steps', 'lost'?)"),
        (["found", "--out", "x.mp4", "--recording", "q"], "it has 'steps', 'lost'"),
        (["nowhere", "--out", "x.mp4"], "nowhere/motions.npz: cannot be read (No such file"),
    ],
)
def test_what_cannot_be_filmed_is_said_in_a_line(
    program: Program,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(folder.parent)
    status, _, error = program(*arguments)
    assert status == 2
    assert says in error
    assert error.count("\n") == 1


def test_a_damaged_file_is_told_of(program: Program, folder: Path) -> None:
    (folder / "motions.npz").write_bytes(b"PK\x03\x04 no more")
    status, _, error = program(folder, "--out", folder / "x.mp4")
    assert status == 2
    assert "is damaged" in error


def test_without_a_driver_the_remedy_is_said(
    program: Program, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setenv("MUJOCO_GL", "nothing")
    monkeypatch.delenv("DISPLAY", raising=False)
    status, _, error = program(folder, "--out", folder / "x.mp4")
    assert status == 2
    assert "apt install libosmesa6" in error
    assert "nothing" in error
    assert not (folder / "x.mp4").exists()


def test_without_what_writes_videos_the_extra_is_said(folder: Path, tmp_path: Path) -> None:
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / "imageio_ffmpeg.py").write_text("raise ImportError")
    first = f"import sys; sys.path.insert(0, {str(hidden)!r})"
    code = f"{first}; from walkerkit.gap.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "replay", str(folder), "--out", str(folder / "x.mp4")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "pip install 'walkerkit[video]'" in done.stderr
