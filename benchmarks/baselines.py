"""What other methods reach on the logs of real hardware: the same split, the same yardstick.

    python -m benchmarks baselines             # all logs, all methods: most of an hour
    python -m benchmarks baselines --quick     # what is not fitted, and of emps what MuJoCo steps

Every figure is what `gap.replay` leaves on the recordings that are held out:

- the model as given;
- the parameters that the makers published (`rivals.published`), which nothing here fits;
- `mujoco.sysid` with armature, damping and frictionloss of each joint (`rivals.mujoco_sysid`), its
  own optimizer on the same recordings; it needs the extra `mujoco[sysid]`;
- PACE's set of parameters and BAM's six models as structures of our catalogue, fitted by our means
  (`rivals.structures` says where that is approximate: what is compared is the structure, not their
  optimizers or their code);
- `gap.diagnose`, which is told none of these.

xl330 has four models of one servo, and every method one set of values for all.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks import Row
from benchmarks.rivals import mujoco_sysid
from benchmarks.rivals.logs import LOGS, Figure, RealLog
from benchmarks.rivals.published import count, published
from benchmarks.rivals.structures import NESTED, STRUCTURES, fit, mended, structure
from walkerkit import gap
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit

_QUICK_LOGS = ("emps",)
_QUICK_STRUCTURES = ("PACE", "BAM M1")  # of effects that MuJoCo has itself


@dataclass(frozen=True, kw_only=True)
class _Reached:
    """What a method reached on the recordings that are held out."""

    method: str
    figure: Figure
    parameters: int
    seconds: float
    note: str = ""


def run(*, quick: bool) -> list[Row]:
    """All methods on all logs."""
    rows = []
    for log in LOGS:
        try:
            problem = log.load()
        except FileNotFoundError as missing:
            print(missing, flush=True)
            continue
        given = 0.0  # the first of the methods changes nothing
        for reached in _methods(log, problem, quick=quick):
            size = float(np.linalg.norm(reached.figure))
            given = given or size
            notes = (f"{size / given:.0%} of as given", reached.note)
            row = Row(
                what=f"{log.name}: {reached.method}",
                result=f"{log.said(reached.figure)}, {reached.parameters} parameters, "
                f"{reached.seconds:.0f} s",
                reference="; ".join(note for note in notes if note),
            )
            print(f"{row.what:30} {row.result}; {row.reference}", flush=True)
            rows.append(row)
    return rows


def _methods(log: RealLog, problem: Problem, *, quick: bool) -> Iterator[_Reached]:
    start = time.perf_counter()
    given = log.figure(problem, gap.replay(problem).gap)
    seconds = time.perf_counter() - start
    yield _Reached(method="as given", figure=given, parameters=0, seconds=seconds, note=log.what)
    yield _published(log, problem)
    if quick and log.name not in _QUICK_LOGS:
        return
    if mujoco_sysid.available():
        yield _sysid(log, problem)
    else:
        print(f"{log.name}: mujoco.sysid left out: pip install 'mujoco[sysid]'", flush=True)
    fits: dict[str, Fit] = {}
    for name in _QUICK_STRUCTURES if quick else STRUCTURES:
        try:
            effects, missing = structure(name, problem)
        except ValueError as reason:
            print(f"{log.name}: {name} left out: {reason}", flush=True)
            continue
        known = [other for other in NESTED.get(name, ()) if other in fits]
        start = time.perf_counter()
        fits[name] = found = fit(problem, effects, [fits[other] for other in known])
        seconds = time.perf_counter() - start
        yield _Reached(
            method=name,
            figure=log.figure(problem, gap.replay(problem, mended(problem, found)).gap),
            parameters=len(found.values),
            seconds=seconds,
            note="; ".join(
                [f"without {', '.join(missing)}"] * bool(missing)
                + [f"also from {', '.join(known)}"] * bool(known)
            ),
        )
    if not quick:
        yield _diagnosed(log, problem)


def _published(log: RealLog, problem: Problem) -> _Reached:
    start = time.perf_counter()
    made = gap.replay(problem, published(log.name, problem)).gap
    return _Reached(
        method="makers' parameters",
        figure=log.figure(problem, made),
        parameters=count(log.name),
        seconds=time.perf_counter() - start,
        note="not fitted here",
    )


def _sysid(log: RealLog, problem: Problem) -> _Reached:
    start = time.perf_counter()
    found = mujoco_sysid.identify(problem)
    seconds = time.perf_counter() - start
    models = len(problem.robots)
    return _Reached(
        method="mujoco.sysid",
        figure=log.figure(problem, gap.replay(problem, found.robots).gap),
        parameters=len(found.values),
        seconds=seconds,
        note=f"one set of values for {models} models" if models > 1 else "",
    )


def _diagnosed(log: RealLog, problem: Problem) -> _Reached:
    start = time.perf_counter()
    result = log.diagnose()
    effects = result.diagnosis.effects
    return _Reached(
        method="gap.diagnose",
        figure=log.figure(problem, result.diagnosis.gap),
        parameters=sum(len(effect.parameters) for effect in effects),
        seconds=time.perf_counter() - start,
        note=", ".join(effect.effect for effect in effects),
    )
