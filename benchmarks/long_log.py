"""How much memory an hour of a leg's log takes, and how long it takes to be read and diagnosed.

    python -m benchmarks long_log             # an hour at 500 Hz
    python -m benchmarks long_log --quick     # a minute

The robot of the log has damping that its model has not. Each step runs in a process of its own, of
which the kernel tells the most memory that was resident: with the imports, which are told beside.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from benchmarks import Row
from walkerkit.tasks.excitation import BATTERY
from walkerkit.walkers import LEG_XML

FloatArray = NDArray[np.float64]

RATE = 500.0
SECONDS, QUICK_SECONDS = 3600.0, 60.0
BOUND = 2.0  # GiB
EFFECTS = ("viscous_friction", "coulomb_friction", "armature", "command_delay")
_PIECE = 60.0  # s that are simulated and written at a time
_NOISE = 1e-4  # rad
_DAMPING = 0.3  # N·m·s/rad, more than the model's
_TOLD = """
from benchmarks.measured.memory import peak
print("peak", peak())
"""
_STEPS = {
    "imports alone": "from walkerkit.gap.workflow import diagnose\n",
    "compare": "from walkerkit import gap\n"
    "d = gap.compare({model!r}, [{log!r}])\nprint('gap', d.gap.position.before)\n",
    "diagnose, four effects": "from walkerkit import gap\n"
    "d = gap.diagnose({model!r}, [{log!r}], effects={effects!r})\n"
    "print('effects', [e.effect for e in d.diagnosis.effects])\n",
}


def run(*, quick: bool) -> list[Row]:
    """Writes the log, then reads it in a process for each step."""
    seconds = QUICK_SECONDS if quick else SECONDS
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".parquet",) if quick else (".parquet", ".csv"):
            log = write_log(Path(folder) / f"leg{suffix}", seconds)
            for what in _STEPS if suffix == ".parquet" else ("compare",):
                peak, took, said = peak_of(what, log)
                print(f"  {log.name}, {what}: {peak:.2f} GiB, {took:.0f} s, {said}", flush=True)
                rows.append(
                    Row(
                        what=f"{seconds:.0f} s at {RATE:.0f} Hz as {suffix}: {what}",
                        result=f"{peak:.2f} GiB at most, {took:.0f} s",
                        reference=f"{log.stat().st_size / 2**30:.2f} GiB file",
                        required=f"<= {BOUND:g} GiB" if what != "imports alone" else "",
                    )
                )
    return rows


def peak_of(what: str, log: Path) -> tuple[float, float, str]:
    """Runs a step in a process of its own.

    Args:
        what: one of the steps.
        log: the recording.

    Returns:
        The most memory that was resident [GiB], the time [s], and what it printed.
    """
    given = {"model": str(LEG_XML), "log": str(log), "effects": list(EFFECTS)}
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _STEPS[what].format(**given) + _TOLD],
        check=True,
        capture_output=True,
        text=True,
    )
    took = time.perf_counter() - start
    *said, last = done.stdout.splitlines()
    return float(last.removeprefix("peak ")), took, "; ".join(said)


def write_log(path: Path, seconds: float) -> Path:
    """Simulates a leg and writes what it does, a piece at a time.

    Args:
        path: .parquet or .csv.
        seconds: how long it runs.
    """
    sink = None
    for columns in _pieces(seconds):
        table = pyarrow.table(columns)
        if sink is None:
            sink = (
                pyarrow.csv.CSVWriter(path, table.schema)
                if path.suffix == ".csv"
                else pyarrow.parquet.ParquetWriter(path, table.schema)
            )
        sink.write_table(table)
    if sink is not None:
        sink.close()
    return path


def _pieces(seconds: float) -> Iterator[dict[str, FloatArray]]:
    model = mujoco.MjModel.from_xml_path(str(LEG_XML))
    model.dof_damping[:] += _DAMPING
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    joints = [model.joint(int(model.actuator_trnid[k, 0])).name for k in range(model.nu)]
    ids = model.actuator_trnid[:, 0]
    middle = model.key_qpos[0][model.jnt_qposadr[ids]]
    every = round(1 / RATE / model.opt.timestep)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    names = ("multisine", "slow_triangle", "steps", "chirp")
    first = 0
    for k in range(int(np.ceil(seconds / _PIECE))):
        clock = np.arange(round(min(_PIECE, seconds - k * _PIECE) * RATE)) / RATE
        sent = BATTERY[names[k % len(names)]](
            clock, lower=middle - 0.25, upper=middle + 0.25, rng=rng, max_velocity=6.0
        )
        held = np.repeat(sent, every, axis=0)
        states, _ = mujoco.rollout.rollout(model, data, state, held)
        # A sample shows the state as its target is sent.
        shown = np.concatenate([state[None], states[0][every - 1 :: every]])
        state = shown[-1].copy()
        q = shown[:-1, 1 : 1 + model.nq] + rng.normal(scale=_NOISE, size=sent.shape)
        columns = {"time": (first + np.arange(len(clock))) / RATE}
        for j, joint in enumerate(joints):
            columns[f"{joint}/position"] = q[:, j]
            columns[f"{joint}/position_target"] = sent[:, j]
        first += len(clock)
        yield columns
