"""What is left behind by runs that are killed, interrupted or run out of disk."""

from __future__ import annotations

import contextlib
import json
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gap.progress import without_progress
from tests.gap.servo import SERVO
from walkerkit.gap import InputError, diagnose
from walkerkit.gap.report.claim import CHECKPOINT, claimed
from walkerkit.gap.search import fit
from walkerkit.gap.search.journal import Journal, digest, finished, packed, unpacked
from walkerkit.walkers.batch import count_warnings, counted_warnings

EFFECTS = ("viscous_friction", "command_delay")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model, two short logs, and the result of a run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("robot")
    (folder / "servo.xml").write_text(SERVO)
    stamps = np.arange(120) / 250
    for name, rate in (("a", 3.0), ("b", 5.0), ("c", 4.0)):
        rows = np.stack(
            [stamps, 0.3 * np.sin(rate * stamps), 0.29 * np.sin(rate * stamps - 0.06)], axis=1
        )
        text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
        (folder / f"{name}.csv").write_text(f"time,knee/position_target,knee/position\n{text}\n")
    run(folder, "undisturbed")
    return folder


def run(folder: Path, out: str, *, effects: tuple[str, ...] = EFFECTS, **options: bool) -> None:
    with contextlib.chdir(folder):
        logs = [f"{name}.csv" for name in "abc"]
        diagnose("servo.xml", logs, effects=effects, out=out, n_threads=1, **options)


def content(folder: Path) -> dict[str, bytes]:
    """Everything in a folder, but for how long it took."""
    return {
        path.name: re.sub(rb'"seconds": [\d.]+|Diagnosed in [\d.]+ s', b"", path.read_bytes())
        for path in folder.iterdir()
    }


@contextlib.contextmanager
def full_disk(most: int) -> Iterator[None]:
    """No file can grow beyond so many bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_nothing_half_written_and_nothing_is_done_twice(
    robot: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with full_disk(1_000_000), pytest.raises(InputError, match=r"full: cannot be written \(File"):
        run(robot, "full")
    assert [path.name for path in (robot / "full").iterdir()] == [CHECKPOINT]

    def again(*arguments: object) -> None:
        raise AssertionError("done already")

    with monkeypatch.context() as patch:
        for step in ("_fit", "_evaluate"):
            patch.setattr(fit, step, again)
        run(robot, "full")
    assert content(robot / "full") == content(robot / "undisturbed")


def test_a_full_disk_on_the_way_does_not_stop_the_search(robot: Path) -> None:
    with full_disk(2_000), pytest.raises(InputError, match="cannot be written"):
        run(robot, "filling")
    kept = (robot / "filling" / CHECKPOINT).read_bytes()
    assert 0 < len(kept) <= 2_000
    assert kept.endswith(b"\n")


def test_a_search_goes_on_from_any_byte_of_its_checkpoint(robot: Path) -> None:
    with full_disk(1_000_000), pytest.raises(InputError):
        run(robot, "cut")
    whole = (robot / "cut" / CHECKPOINT).read_bytes()
    for part in (0.1, 0.8):
        shutil.rmtree(robot / "cut")
        (robot / "cut/.writing-abc").mkdir(parents=True)
        (robot / "cut" / CHECKPOINT).write_bytes(whole[: int(part * len(whole))])
        run(robot, "cut")
        assert content(robot / "cut") == content(robot / "undisturbed")


def program(folder: Path, *more: str) -> subprocess.Popen[str]:
    effects = [word for name in EFFECTS for word in ("--effect", name)]
    command = ["diagnose", "servo.xml", "a.csv", "b.csv", "c.csv", "--threads", "1", *effects]
    return subprocess.Popen(
        [sys.executable, "-m", "walkerkit.gap", *command, *more],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # What runs the tests in the background may have had Ctrl-C ignored, which is inherited.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def send_when(process: subprocess.Popen[str], checkpoint: Path, steps: int, number: int) -> None:
    """Sends a signal once so many steps are finished."""
    deadline = time.monotonic() + 200
    while not checkpoint.exists() or checkpoint.read_bytes().count(b"\n") <= steps:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)


def test_kill_and_ctrl_c(robot: Path) -> None:
    checkpoint = robot / "killed" / CHECKPOINT
    killed = program(robot, "--out", "killed")
    send_when(killed, checkpoint, 2, signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    assert [path.name for path in (robot / "killed").iterdir()] == [CHECKPOINT]
    first = checkpoint.read_bytes()
    stopped = program(robot, "--out", "killed")
    send_when(stopped, checkpoint, first.count(b"\n"), signal.SIGINT)
    assert stopped.stderr is not None
    for line in stopped.stderr:  # a first one lets the search end with what it has
        if line.startswith("Stopping with what was found so far."):
            break
    stopped.send_signal(signal.SIGINT)
    _, error = stopped.communicate()
    assert (stopped.returncode, without_progress(error).strip()) == (
        130,
        "walkerkit: interrupted. The same command goes on from there.",
    )
    assert checkpoint.read_bytes().startswith(first)
    run(robot, "killed")
    assert content(robot / "killed") == content(robot / "undisturbed")
    run(robot, "killed")  # its own result may be replaced
    assert content(robot / "killed") == content(robot / "undisturbed")


def test_a_search_that_is_stopped_has_a_result(robot: Path) -> None:
    stopped = program(robot, "--out", "stopped")
    send_when(stopped, robot / "stopped" / CHECKPOINT, 1, signal.SIGINT)
    out, error = stopped.communicate()
    assert stopped.returncode == 0, error
    assert out.splitlines()[-1] == "stopped/report.html"
    assert "Stopping with what was found so far." in error
    told = json.loads((robot / "stopped/diagnosis.json").read_text(encoding="utf-8"))
    assert told["verdict"] in ("explained", "partly_explained", "unexplained")
    run(robot, "stopped")  # whole, it takes that one's place
    assert content(robot / "stopped") == content(robot / "undisturbed")


def test_a_closed_pipe_is_no_failure_of_ours(robot: Path) -> None:
    with program(robot, "--out", "piped", "--json") as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert without_progress(process.stderr.read()) == ""
    assert process.returncode == 141
    assert content(robot / "piped") == content(robot / "undisturbed")


def test_the_result_of_another_run_stays_unless_told_otherwise(robot: Path) -> None:
    shutil.copytree(robot / "undisturbed", robot / "mine")
    before = content(robot / "mine")
    with pytest.raises(InputError, match=r"mine: has model.xml of another run .* --overwrite"):
        run(robot, "mine", effects=("torque_bias",))
    assert content(robot / "mine") == before
    run(robot, "mine", effects=("torque_bias",), overwrite=True)
    after = content(robot / "mine")
    assert after["diagnosis.json"] != before["diagnosis.json"]
    run_now, run_before = (json.loads(one[".walkerkit-run.json"])["run"] for one in (after, before))
    assert run_now != run_before


def test_a_model_of_the_users_own_is_not_replaced(robot: Path) -> None:
    (robot / "own").mkdir()
    (robot / "own/model.xml").write_text(SERVO)
    with pytest.raises(InputError, match="own: has model\\.xml"):
        run(robot, "own")
    assert (robot / "own/model.xml").read_text() == SERVO


def test_two_runs_do_not_share_a_folder(robot: Path) -> None:
    (robot / "shared").mkdir()
    with (
        Journal.open(robot / "shared" / CHECKPOINT, "key"),
        pytest.raises(InputError, match="another run is at work in it"),
    ):
        run(robot, "shared")


def test_an_overwritten_result_stays_whole_when_the_new_one_fails(robot: Path) -> None:
    shutil.copytree(robot / "undisturbed", robot / "old")
    before = content(robot / "old")
    with full_disk(1_000_000), pytest.raises(InputError, match="cannot be written"):
        run(robot, "old", effects=("torque_bias",), overwrite=True)
    after = content(robot / "old")
    assert after.pop(CHECKPOINT)
    assert after == before


def test_a_folder_that_cannot_be_made_is_refused_before_any_work() -> None:
    """The kernel's own, in which not even root may write."""
    with (
        pytest.raises(InputError, match="/proc/out: cannot be written"),
        claimed(Path("/proc/out"), "key", [], overwrite=False),
    ):
        raise AssertionError("worked in vain")


# The journal itself


def test_arrays_come_back_bit_for_bit() -> None:
    arrays = [
        np.array(np.inf),
        np.array([[0.1, -0.0], [np.nan, 5e-324]]),
        np.zeros((0, 3)),
        np.arange(6.0).reshape(2, 3).T,
    ]
    for array, back in zip(arrays, unpacked(json.loads(json.dumps(packed(arrays)))), strict=True):
        assert back.shape == array.shape
        assert back.tobytes() == array.tobytes()


def test_a_journal_knows_its_steps_by_place_and_inputs(tmp_path: Path) -> None:
    made = []

    def step(name: str, inner: str | None = None) -> str:
        def make() -> str:
            made.append(name)
            count_warnings({"bad control": 1})
            return name + (step(inner) if inner else "")

        return finished(digest(name), make, str.upper, str.lower)

    def search(*last: str) -> list[str]:
        made.clear()
        return [step("a"), step("b", inner="c"), *(step(name) for name in last)]

    path = tmp_path / "journal"
    counts = []
    for last in (("d",), ("d", "d"), ("e",)):
        with Journal.open(path, "key") as journal, journal.kept(), counted_warnings() as warned:
            assert search(*last) == ["a", "bc", *last]
        counts.append((list(made), warned["bad control"]))
    assert counts == [(["a", "b", "c", "d"], 4), (["d"], 5), (["e"], 4)]
    with Journal.open(path, "other key") as journal, journal.kept():
        search()
    assert made == ["a", "b", "c"]


def test_a_damaged_journal_is_used_up_to_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "journal"

    def steps() -> list[int]:
        with Journal.open(path, "key") as journal, journal.kept():
            known = len(journal)
            return [known, *(finished(str(k), lambda k=k: k, int, int) for k in range(4))]

    assert steps() == [0, 0, 1, 2, 3]
    assert steps() == [4, 0, 1, 2, 3]
    data = bytearray(path.read_bytes())
    data[data.index(b'"3 ') + 1] ^= 1
    path.write_bytes(data)
    assert steps() == [2, 0, 1, 2, 3]
    path.write_bytes(b"\x80\x04pickle?")
    assert steps() == [0, 0, 1, 2, 3]
