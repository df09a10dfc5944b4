"""The examples of our robots, run."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from walkerkit.walkers import Trot

NO_SCREEN = {"DISPLAY", "WAYLAND_DISPLAY"}


def run(repository: Path, name: str, *arguments: str, **environment: str):
    """An example as a user starts it, without a screen."""
    kept = {key: value for key, value in os.environ.items() if key not in NO_SCREEN}
    return subprocess.run(
        [sys.executable, str(repository / "examples" / name), *arguments],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


PROGRAMS = sorted(
    path.name
    for path in (Path(__file__).parent.parent / "examples").glob("*.py")
    if not path.name.startswith("_")
)


@pytest.mark.parametrize("name", PROGRAMS)
def test_asked_for_help_a_program_says_what_it_takes_and_does_nothing(
    repository: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    monkeypatch.syspath_prepend(str(repository / "examples"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(repository / "examples" / name), run_name="__main__")
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: {name} ")
    assert not any(tmp_path.iterdir())


def test_stand(example, capsys):
    results = example("stand").main(2.0)
    assert set(results) == {"quadruped", "biped"}
    for stood in results.values():
        assert stood.fell == ()
        assert stood.seconds == pytest.approx(2.0, abs=0.02)
        assert stood.efforts.shape == (100, 12)
        assert (np.abs(stood.efforts) < stood.limits).all()
        assert np.abs(stood.efforts).max() > 1.0
    printed = capsys.readouterr().out
    assert "biped: stands after 2.0 s" in printed
    assert "left_ankle_pitch" in printed
    assert len(printed.splitlines()) == 2 * (2 + 12)


def test_trot(example, capsys):
    trotted = example("trot").main(8.0)
    assert trotted.speed >= 0.25
    assert trotted.fell == ()
    assert trotted.seconds == pytest.approx(8.0, abs=0.02)
    assert "did not fall" in capsys.readouterr().out


def test_trot_of_a_gait_that_falls_is_told(example, monkeypatch, capsys):
    trot = example("trot")
    monkeypatch.setattr(trot, "Trot", lambda: Trot(stride=0.2, frequency=1.0, fade=0.0, lift=0.12))
    trotted = trot.main(8.0)
    assert trotted.fell
    assert trotted.seconds < 8.0
    assert f"fell: {', '.join(trotted.fell)}" in capsys.readouterr().out


@pytest.mark.parametrize("robot", ["quadruped", "biped", "leg", "servo_bench"])
def test_view_has_a_scene_and_a_policy_for_each_robot(example, robot):
    view = example("view")
    assert robot in view.ROBOTS
    environment, policy = view.scene(robot)
    step = environment.reset()
    for _ in range(20):
        action = policy(step)
        environment.action_spec().validate(action)
        step = environment.step(action)
        assert not step.last()


def test_view_says_that_it_needs_a_display(repository):
    done = run(repository, "view.py", "biped")
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("no display, so there is no window to open")
    assert "examples/video.py" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_video_says_what_to_set_where_nothing_renders(repository, tmp_path):
    done = run(repository, "video.py", str(tmp_path / "trot.gif"), MUJOCO_GL="disable")
    assert done.returncode == 1
    assert "cannot render with MUJOCO_GL=disable" in done.stderr
    assert "MUJOCO_GL=osmesa" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "trot.gif").exists()


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_video(repository, tmp_path, backend):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "trot.gif"
    arguments = (str(path), "--seconds", "0.4", "--size", "96", "64")
    done = run(repository, "video.py", *arguments, MUJOCO_GL=backend)
    if "cannot render with" in done.stderr:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    with image.open(path) as video:
        assert video.size == (96, 64)
        assert video.n_frames == 11
        pictures = []
        for i in (0, 10):
            video.seek(i)
            pictures.append(np.array(video.convert("RGB"), dtype=int))
    # It shows something, which moves.
    assert np.ptp(pictures[0]) > 100
    assert np.abs(pictures[1] - pictures[0]).max() > 50


def test_vector_env(example, capsys):
    learned = example("vector_env").main(3, n=16, seconds=0.6)
    assert learned.returns.shape == (3, 16)
    assert learned.returns[-1].mean() > learned.returns[0].mean()
    assert learned.steps_per_second > 0
    assert "generation 2: mean reward" in capsys.readouterr().out
