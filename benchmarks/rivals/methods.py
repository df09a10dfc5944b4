"""Every method on a log of real hardware: what it reaches on the recordings that are held out.

for reached in methods(log, log.load(), ["plain", "PACE"]):
    reached.method, log.said(reached.figure), reached.seconds
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from benchmarks.rivals import mujoco_sysid
from benchmarks.rivals.logs import Figure, RealLog
from benchmarks.rivals.plain import plain
from benchmarks.rivals.published import count, published
from benchmarks.rivals.structures import NESTED, STRUCTURES, fit, mended, structure
from walkerkit import gap
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit

GIVEN, PUBLISHED, PLAIN, DIAGNOSIS = "as given", "makers' parameters", "plain", "gap.diagnose"
SYSID, SYSID_PLAIN = "mujoco.sysid", "mujoco.sysid, plain"
METHODS = (GIVEN, PUBLISHED, PLAIN, SYSID, SYSID_PLAIN, *STRUCTURES, DIAGNOSIS)
"""Names of the methods, in the order in which they come."""
RIVALS = (PLAIN, SYSID, SYSID_PLAIN, *STRUCTURES)
"""Those that fit a structure that was known beforehand."""

_DELAY = "command_delay"  # which the rollouts of `mujoco.sysid` have no gradient of


@dataclass(frozen=True, kw_only=True)
class Reached:
    """What a method reached.

    Attributes:
        method: its name.
        figure: the log's figure on the recordings that are held out.
        parameters: how many numbers it fits.
        seconds: it took.
        note: what else is to be said of it.
    """

    method: str
    figure: Figure
    parameters: int
    seconds: float
    note: str = ""


def methods(log: RealLog, problem: Problem, chosen: Collection[str] = METHODS) -> Iterator[Reached]:
    """Runs methods on a log, and prints which of them it cannot have.

    Args:
        log: the log.
        problem: what it loads.
        chosen: names of the methods.
    """
    if GIVEN in chosen:
        start = time.perf_counter()
        given = log.figure(problem, gap.replay(problem).gap)
        seconds = time.perf_counter() - start
        yield Reached(method=GIVEN, figure=given, parameters=0, seconds=seconds, note=log.what)
    if PUBLISHED in chosen:
        yield _published(log, problem)
    if PLAIN in chosen:
        yield _plain(log, problem)
    for name in (SYSID, SYSID_PLAIN):
        if name in chosen and mujoco_sysid.available():
            yield _sysid(log, problem, name)
        elif name in chosen:
            print(f"{log.name}: {name} left out: pip install 'mujoco[sysid]'", flush=True)
    yield from _structures(log, problem, [name for name in STRUCTURES if name in chosen])
    if DIAGNOSIS in chosen:
        yield _diagnosed(log, problem)


def _plain(log: RealLog, problem: Problem) -> Reached:
    start = time.perf_counter()
    fitted = gap.fit(problem, plain(problem))
    return Reached(
        method=PLAIN,
        figure=log.figure(problem, fitted.gap),
        parameters=sum(len(effect.parameters) for effect in fitted.effects),
        seconds=time.perf_counter() - start,
        note=", ".join(effect.effect for effect in fitted.effects),
    )


def _structures(log: RealLog, problem: Problem, chosen: Collection[str]) -> Iterator[Reached]:
    """The published sets of parameters, each also from those that it is more of."""
    fits: dict[str, Fit] = {}
    for name in chosen:
        try:
            effects, missing = structure(name, problem)
        except ValueError as reason:
            print(f"{log.name}: {name} left out: {reason}", flush=True)
            continue
        known = [other for other in NESTED.get(name, ()) if other in fits]
        start = time.perf_counter()
        fits[name] = found = fit(problem, effects, [fits[other] for other in known])
        seconds = time.perf_counter() - start
        yield Reached(
            method=name,
            figure=log.figure(problem, gap.replay(problem, mended(problem, found)).gap),
            parameters=len(found.values),
            seconds=seconds,
            note="; ".join(
                [f"without {', '.join(missing)}"] * bool(missing)
                + [f"also from {', '.join(known)}"] * bool(known)
            ),
        )


def _published(log: RealLog, problem: Problem) -> Reached:
    start = time.perf_counter()
    made = gap.replay(problem, published(log.name, problem)).gap
    return Reached(
        method=PUBLISHED,
        figure=log.figure(problem, made),
        parameters=count(log.name),
        seconds=time.perf_counter() - start,
        note="not fitted here",
    )


def _sysid(log: RealLog, problem: Problem, name: str) -> Reached:
    effects = mujoco_sysid.EFFECTS if name == SYSID else tuple(plain(problem))
    start = time.perf_counter()
    found = mujoco_sysid.identify(problem, effects=[one for one in effects if one != _DELAY])
    seconds = time.perf_counter() - start
    models = len(problem.robots)
    return Reached(
        method=name,
        figure=log.figure(problem, gap.replay(problem, found.robots).gap),
        parameters=len(found.values),
        seconds=seconds,
        note=f"one set of values for {models} models" if models > 1 else "",
    )


def _diagnosed(log: RealLog, problem: Problem) -> Reached:
    start = time.perf_counter()
    result = log.diagnose()
    effects = result.diagnosis.effects
    return Reached(
        method=DIAGNOSIS,
        figure=log.figure(problem, result.diagnosis.gap),
        parameters=sum(len(effect.parameters) for effect in effects),
        seconds=time.perf_counter() - start,
        note=", ".join(effect.effect for effect in effects),
    )
