"""What a diagnosis costs: how much of it is MuJoCo's own time, and how it grows.

    python -m benchmarks diagnose                # a leg, a hung quadruped, and what they scale with
    python -m benchmarks diagnose --quick
    python -m benchmarks diagnose --out figures  # and a plot of it

The simulation steps are counted, in all processes that share the work, and what `mujoco.rollout`
takes for as many of the model as given, side by side on two threads with nothing else to do, is
compared with the time of the diagnosis. The time within the calls of `mujoco.batch` is told beside
it, of the time that the processes are at work: friction, plays and other integrators that the
search tries are dearer than the model as given, but the lock-step engine does not let MuJoCo read
the clock in each step as `mujoco.rollout` does, which is half of a small model's step. Costs are
then measured against the length of the logs, the number of joints and the number of effects; an
exponent of 1 is linear, one below it is less, where the search takes a share of long logs.
"""

from __future__ import annotations

import contextlib
import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import mujoco
import mujoco.rollout
import numpy as np
import plotly.graph_objects as go
from mujoco.batch import Batch
from plotly.subplots import make_subplots

from benchmarks import Row
from benchmarks.hidden.rigs import write_rig
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.simulation import together
from walkerkit.walkers.batch import LockStep

THREADS = 2
SHARE = 0.6
HIDDEN = "viscous_friction"
_RAW_SIMS, _RAW_STEPS, _RAW_TURNS = 64, 500, 5
_ORDER = (
    *("viscous_friction", "coulomb_friction", "armature", "torque_bias", "position_gain"),
    *("command_delay", "payload", "velocity_gain", "encoder_offset", "parallel_spring"),
)
"""Effects with which a small catalogue begins, MuJoCo's own first."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What one diagnosis took.

    Attributes:
        seconds: of wall time.
        busy: that all processes were at work, added up [s].
        inside: of that, within MuJoCo's calls [s].
        steps: of the simulation, all variants together.
        raw: what one step of the model as given takes on two threads [s].
        named: the effects that were named.
    """

    seconds: float
    busy: float
    inside: float
    steps: int
    raw: float
    named: tuple[str, ...]

    @property
    def alone(self) -> float:
        """What as many raw steps take [s]."""
        return self.steps * self.raw


def run(*, quick: bool, out: Path | None = None) -> list[Row]:
    """Diagnoses both robots, then what grows."""
    rows = []
    cases: tuple[tuple[str, float, float, str], ...] = (
        ("leg", 12.0, 20.0, f">= {SHARE:.0%}"),
        ("hung_quadruped", 20.0, 60.0, ""),
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for rig, seconds, most, share in [("pendulum", 2.0, 20.0, "")] if quick else cases:
            effects = _ORDER[:3] if quick else tuple(CATALOGUE)
            cost = diagnosed(rig, folder, seconds=seconds, effects=effects)
            what = f"diagnose {rig}, three {seconds:.0f} s logs, {len(effects)} effects"
            print(
                f"  {what}: {cost.seconds:.1f} s, {cost.steps:.3g} steps of {cost.raw * 1e6:.2f} "
                f"µs, {', '.join(cost.named) or 'nothing'} named",
                flush=True,
            )
            rows += [
                Row(
                    what=what,
                    result=f"{cost.seconds:.1f} s",
                    required="" if quick else f"<= {most:g} s",
                ),
                Row(
                    what="what its steps alone take, of that",
                    result=f"{cost.alone / cost.seconds:.0%}",
                    reference=f"{cost.steps:.3g} steps of {cost.raw * 1e6:.2f} µs on two threads: "
                    f"{cost.alone:.1f} s",
                    required=share,
                ),
                Row(
                    what="its share of time inside MuJoCo",
                    result=f"{cost.inside / cost.busy:.0%}",
                    reference=f"{cost.inside:.1f} s of {cost.busy:.1f} s in mujoco.batch",
                ),
            ]
        curves = grown(folder, quick=quick)
    for of, points in curves.items():
        sizes, seconds_of = np.array(points).T
        power = exponent(sizes, seconds_of)
        rows.append(
            Row(
                what=f"diagnose: growth with {of}",
                result=f"exponent {power:.2f}",
                reference=", ".join(f"{x:g}: {y:.1f} s" for x, y in points),
                required="<= 1",
            )
        )
    if out is not None:
        plot(curves, out)
    return rows


def grown(folder: Path, *, quick: bool) -> dict[str, list[tuple[float, float]]]:
    """Seconds of a diagnosis against seconds of each log, joints, and effects."""
    lengths = (2.0, 4.0) if quick else (5.0, 10.0, 20.0, 40.0)
    rigs = {"pendulum": 1} if quick else {"pendulum": 1, "leg": 3, "hung_quadruped": 12}
    counts = (1, 2) if quick else (2, 4, 7, 10)
    few = _ORDER[: 2 if quick else 4]
    robot = "pendulum" if quick else "leg"
    curves: dict[str, list[tuple[float, float]]] = {"seconds of log": [], "joints": []}
    for seconds in lengths:
        cost = diagnosed(robot, folder, seconds=seconds, effects=few)
        curves["seconds of log"].append((seconds, cost.seconds))
    if len(rigs) > 1:
        for rig, joints in rigs.items():
            cost = diagnosed(rig, folder, seconds=lengths[1], effects=few)
            curves["joints"].append((joints, cost.seconds))
    curves["effects"] = [
        (n, diagnosed(robot, folder, seconds=lengths[0], effects=_ORDER[:n]).seconds)
        for n in counts
    ]
    for of, points in curves.items():
        print(f"  {of}: " + ", ".join(f"{x:g}: {y:.2f} s" for x, y in points), flush=True)
    return {of: points for of, points in curves.items() if points}


def diagnosed(rig: str, folder: Path, *, seconds: float, effects: Sequence[str]) -> Cost:
    """Records a robot in which something is hidden, and diagnoses it.

    Args:
        rig: one of the rigs of the hidden-effects benchmark.
        folder: for its model.
        seconds: length of each of three logs, at 500 Hz.
        effects: what the workflow knows of.
    """
    path = write_rig(rig, folder, file=f"{rig}.xml")
    logs = rehearse(path, [HIDDEN], seed=0, seconds=seconds).recordings
    raw = raw_step(mujoco.MjModel.from_xml_path(str(path)))
    with counted_steps() as count, time_inside() as inside, counted_elsewhere() as elsewhere:
        start = time.perf_counter()
        found = gap.diagnose(path, logs, effects=effects, n_threads=THREADS).diagnosis
        took = time.perf_counter() - start
    return Cost(
        seconds=took,
        busy=took - elsewhere.waited + elsewhere.busy,
        inside=inside[0] + elsewhere.inside,
        steps=count[0] + elsewhere.steps,
        raw=raw,
        named=tuple(effect.effect for effect in found.effects),
    )


@contextlib.contextmanager
def time_inside() -> Iterator[list[float]]:
    """Adds up the time within the calls that step simulations [s]."""
    inside = [0.0]
    with contextlib.ExitStack() as patched:
        for name in ("rollout", "step"):
            call = getattr(Batch, name)

            def timed(self: Batch, *args: Any, call: Any = call, **kwargs: Any) -> Any:
                start = time.perf_counter()
                try:
                    return call(self, *args, **kwargs)
                finally:
                    inside[0] += time.perf_counter() - start

            patched.enter_context(mock.patch.object(Batch, name, timed))
        yield inside


@contextlib.contextmanager
def counted_steps() -> Iterator[list[int]]:
    """Counts the steps of all simulations in lock step."""
    count = [0]
    rollout, step_by_step = LockStep.rollout, LockStep.step_by_step

    def counted_rollout(self: LockStep, state: Any, **given: Any) -> Any:
        count[0] += given["ctrl"].shape[0] * given["ctrl"].shape[1]
        return rollout(self, state, **given)

    def counted_stepwise(
        self: LockStep, state: Any, n_steps: int, before: Any, **given: Any
    ) -> Any:
        count[0] += self.n_sims * n_steps
        return step_by_step(self, state, n_steps, before, **given)

    with (
        mock.patch.object(LockStep, "rollout", counted_rollout),
        mock.patch.object(LockStep, "step_by_step", counted_stepwise),
    ):
        yield count


@dataclass(kw_only=True)
class Elsewhere:
    """What other processes did, and how long this one waited for them [s]."""

    steps: int = 0
    inside: float = 0.0
    busy: float = 0.0
    waited: float = 0.0


def _measured(given: tuple[Callable[[Any], Any], Any]) -> tuple[Any, int, float, float]:
    function, job = given
    with counted_steps() as count, time_inside() as inside:
        start = time.perf_counter()
        result = function(job)
        return result, count[0], inside[0], time.perf_counter() - start


@contextlib.contextmanager
def counted_elsewhere() -> Iterator[Elsewhere]:
    """Adds up what the processes do that share the work."""
    found = Elsewhere()
    side_by_side = together.side_by_side

    def counted(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
        start = time.perf_counter()
        done = side_by_side(_measured, [(function, job) for job in jobs])
        here, *others = done
        found.waited += time.perf_counter() - start - here[3]
        for _, steps, inside, busy in others:
            found.steps += steps
            found.inside += inside
            found.busy += busy
        return [result for result, *_ in done]

    with mock.patch.object(together, "side_by_side", counted):
        yield found


def raw_step(model: mujoco.MjModel) -> float:
    """What a step takes with many simulations side by side on two threads [s].

    They start at home, each with targets of its own that move slowly around it.
    """
    data = [mujoco.MjData(model) for _ in range(THREADS)]
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data[0], 0)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data[0], state, kind)
    rng = np.random.default_rng(0)
    size, pace = rng.uniform(0.02, 0.1, (2, _RAW_SIMS, 1, model.nu))
    swing = size * np.sin(pace * np.arange(_RAW_STEPS)[None, :, None])
    control = data[0].ctrl + swing
    states = np.tile(state, (_RAW_SIMS, 1))
    times = []
    with mujoco.rollout.Rollout(nthread=THREADS) as rollout:
        for _ in range(_RAW_TURNS):
            start = time.perf_counter()
            rollout.rollout(model, data, states, control)
            times.append(time.perf_counter() - start)
    return min(times) / (_RAW_SIMS * _RAW_STEPS)


def exponent(sizes: Any, seconds: Any) -> float:
    """The slope of the logarithm of the time over that of the size."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def plot(curves: dict[str, list[tuple[float, float]]], out: Path) -> None:
    """Writes diagnose_cost.html, and .svg where kaleido is installed."""
    figure = make_subplots(cols=len(curves), shared_yaxes=True)
    for column, (of, points) in enumerate(curves.items(), start=1):
        sizes, seconds = np.array(points).T
        linear = seconds[0] * sizes / sizes[0]
        figure.add_trace(
            go.Scatter(x=sizes, y=seconds, mode="markers+lines", name=of), col=column, row=1
        )
        figure.add_trace(
            go.Scatter(x=sizes, y=linear, mode="lines", line_dash="dot", name="linear"),
            col=column,
            row=1,
        )
        figure.update_xaxes(title=of, type="log", col=column, row=1)
    figure.update_yaxes(title="seconds of diagnosis", type="log", col=1)
    out.mkdir(parents=True, exist_ok=True)
    figure.write_html(out / "diagnose_cost.html", include_plotlyjs=True)
    if importlib.util.find_spec("kaleido") is None:
        print("  no diagnose_cost.svg beside diagnose_cost.html: kaleido is not installed")
    else:
        figure.write_image(out / "diagnose_cost.svg")
