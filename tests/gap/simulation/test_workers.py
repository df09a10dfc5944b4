"""Jobs in other processes: in order, whatever happens to the processes."""

import os
import signal
import subprocess
import sys
import time

import mujoco
import numpy as np
import pytest

from walkerkit.gap.simulation.workers import side_by_side
from walkerkit.walkers.batch import LockStep, counted_warnings

HERE = os.getpid()


def where(job: int) -> tuple[int, int]:
    return job, os.getpid()


def refused(job: int) -> int:
    if job == 1:
        raise ValueError(f"job {job}")
    return job


def killed(here: int) -> bool:
    if here != os.getpid():
        os.kill(os.getpid(), signal.SIGKILL)
    return True


def diverged(velocity: float) -> bool:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><option timestep='0.1'/><worldbody><body><joint name='j' stiffness='-1e6'/>"
        "<geom size='0.1'/></body></worldbody></mujoco>"
    )
    lock = LockStep(model, 1, n_threads=1)
    state = lock.batch.state.copy()
    state[:, 2] = velocity  # after time and qpos
    rollout = lock.rollout(state, ctrl=np.zeros((1, 99, 0)))
    return bool(rollout.failed[0])


def test_each_job_has_a_process() -> None:
    jobs, processes = zip(*side_by_side(where, [5, 6, 7]), strict=True)
    assert jobs == (5, 6, 7)
    assert processes[0] == HERE
    assert len(set(processes)) == 3
    # They wait for more.
    again = side_by_side(where, [1, 2, 3])
    assert {process for _, process in again} == set(processes)


@pytest.mark.parametrize("jobs", [[0, 1, 2], [1, 0, 2]])
def test_an_error_is_raised_and_nothing_of_it_remains(jobs: list[int]) -> None:
    with pytest.raises(ValueError, match="job 1"):
        side_by_side(refused, jobs)
    assert [job for job, _ in side_by_side(where, [3, 4, 5])] == [3, 4, 5]


def test_jobs_of_processes_that_die_are_done_here() -> None:
    assert side_by_side(killed, [HERE] * 3) == [True] * 3
    # So are those that died while they waited.
    (_, waiting) = side_by_side(where, [0, 1])[1]
    os.kill(waiting, signal.SIGKILL)
    jobs, processes = zip(*side_by_side(where, [3, 4, 5]), strict=True)
    assert jobs == (3, 4, 5)
    assert waiting not in processes


def test_warnings_of_all_processes_are_counted() -> None:
    with counted_warnings() as counted:
        assert side_by_side(diverged, [1.0, 1.0, 0.0]) == [True, True, False]
    assert sum(counted.values()) == 2


def test_processes_end_with_the_one_that_started_them() -> None:
    script = (
        "import os, sys\n"
        "from walkerkit.gap.simulation.workers import side_by_side\n"
        "from tests.gap.simulation.test_workers import where\n"
        "print(side_by_side(where, [0, 1])[1][1], flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    worker = int(done.stdout)
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    pytest.fail("a process lives on")
