"""The same input gives the same bytes: after pickling, with other threads, in other processes.

`test_workflow` holds whole folders to it; here are the parts that users send between processes.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from tests.gap.servo import SERVO
from walkerkit import gap
from walkerkit.actuators import DcMotorActuatorCfg, DelayedActuatorCfg
from walkerkit.gap.recordings.recording import Recording

EFFECTS = ("viscous_friction", "torque_bias")


def test_products_are_on_one_thread_while_a_step_of_the_workflow_runs(tmp_path: Path) -> None:
    def threads() -> set[int]:
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    (tmp_path / "servo.xml").write_text(SERVO)
    time = np.arange(120) / 250
    target = 0.2 * np.sin(4 * time)
    columns = {"knee/position_target": target, "knee/position": 0.9 * target}
    logs = [Recording(name=name, time=time, columns=columns) for name in "ab"]
    seen: list[set[int]] = []

    def watched(what: str, done: float) -> None:
        seen.append(threads())

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        problem = gap.load(tmp_path / "servo.xml", logs)
        gap.fit(problem, {"viscous_friction": "*"}, progress=watched)
        gap.diagnose(tmp_path / "servo.xml", logs, effects=["torque_bias"], progress=watched)
        assert threads() == before == {2}
    assert len(seen) > 4
    assert all(one == {1} for one in seen)


def test_a_diagnosis_depends_neither_on_threads_nor_on_pickling(tmp_path: Path) -> None:
    (tmp_path / "servo.xml").write_text(SERVO)
    time = np.arange(120) / 250
    recordings = [
        Recording(
            name=name,
            time=time,
            columns={
                "knee/position_target": 0.2 * np.sin(rate * time),
                "knee/position": 0.19 * np.sin(rate * time - 0.07),
            },
        )
        for name, rate in (("a", 4.0), ("b", 6.0))
    ]

    def diagnosed(given: list[Recording], n_threads: int) -> str:
        result = gap.diagnose(
            tmp_path / "servo.xml", given, effects=["viscous_friction"], n_threads=n_threads
        )
        return replace(result.diagnosis, seconds=0.0).to_json()

    first = diagnosed(recordings, 1)
    assert diagnosed(pickle.loads(pickle.dumps(recordings)), 2) == first


EPISODE = """
import hashlib, pickle, sys
import numpy as np
from walkerkit.tasks import suite

configs = pickle.load(open(sys.argv[1], "rb"))
environment = suite.load("cheetah", "run", *configs, task_kwargs={"random": 3})
environment.reset()
random = np.random.default_rng(0)
spec = environment.action_spec()
said = hashlib.sha256()
for _ in range(30):
    observed = environment.step(random.uniform(-0.5, 0.5, spec.shape)).observation
    for value in observed.values():
        said.update(np.asarray(value).tobytes())
print(said.hexdigest())
"""


def test_an_episode_is_the_same_in_every_process(tmp_path: Path) -> None:
    motors = DcMotorActuatorCfg(
        joint_names_expr=(".*thigh", ".*shin", ".*foot"),
        stiffness=60.0,
        damping=2.0,
        saturation_effort=120.0,
        velocity_limit=25.0,
        effort_limit=90.0,
    )
    late = DelayedActuatorCfg(base_cfg=motors, delay_min_lag=0, delay_max_lag=3)
    (tmp_path / "configs.pickle").write_bytes(pickle.dumps([late]))
    said = [
        subprocess.run(
            [sys.executable, "-c", EPISODE, str(tmp_path / "configs.pickle")],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("0", "42")
    ]
    assert said[0] == said[1]
    assert len(said[0].strip()) == len(hashlib.sha256().hexdigest())
