"""What the workflow found: plain results, and the JSON of the contract.

    result = gap.diagnose("leg.xml", ["walk.csv"])
    result.diagnosis.verdict          # plain data
    result.diagnosis.to_json()        # diagnosis.json; docs/report.md says what each key is

`gap.compare` returns the diagnosis itself.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.wiring_errors import WiringError
from walkerkit.gap.report.gaps import Gap, GapMap, GapSize, Location
from walkerkit.gap.report.motion import Motion

FloatArray = NDArray[np.float64]
Verdict = Literal["explained", "partly_explained", "no_gap", "unexplained"]
SCHEMA = 2


@dataclass(frozen=True, kw_only=True)
class Change:
    """A number of a robot's files, before and after.

    Attributes:
        model: short name of the robot's model.
        place: the joint or body, `*` for the whole robot.
        was: the number in the model as it was given, or None where it has no such number.
        now: the number in the mended model, or None where it has none.
    """

    model: str
    place: str
    was: float | None
    now: float | None


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One fitted number.

    Attributes:
        name: e.g. `frictionloss`.
        place: joint or body, or `*` where one value is shared.
        value: the estimate.
        std: its standard error; None at a bound, and where the recordings say nothing of it.
        unit: its unit.
        at_bound: it ran into the bound of its range, so that it is no estimate.
        lower, upper: the bounds of its range.
        field: where it is in the robot's files, element and attribute, e.g. `joint/frictionloss`.
        changes: what each robot had there and has now, with all effects that change it.
        correlation: with each number of all effects, in their order.
    """

    name: str
    place: str
    value: float
    std: float | None
    unit: str
    at_bound: bool
    lower: float = -math.inf
    upper: float = math.inf
    field: str = ""
    changes: tuple[Change, ...] = ()
    correlation: tuple[float, ...] = ()

    @property
    def was(self) -> float | None:
        """The number that all robots had everywhere; None where they differ, or had none."""
        return _same([change.was for change in self.changes])

    @property
    def now(self) -> float | None:
        """The same of the mended robots."""
        return _same([change.now for change in self.changes])

    @property
    def differs(self) -> bool:
        """Whether the robots, or the places that share it, differ in what they had or have."""
        return len({(change.was, change.now) for change in self.changes}) > 1


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """One effect that was added.

    Attributes:
        effect: its name in the catalogue.
        joints: joints that need it; `("*",)` where all share one value; empty for bodies.
        bodies: bodies that need it.
        confidence: how sure the name is, 0 to 1.
        parameters: its numbers.
        gap_after: position gap once it and all before it are added.
        indistinguishable_from: effects that these recordings cannot tell from it.
        gaps_after: as `gap_after`, by signal; not in the JSON.
        equivalent: those of them that no recording of these signals can tell from it, each with the
            reason, a sentence; `reasons` in the JSON.
        share: part of the gap where it acts, above the noise, that it makes up for; NaN where that
            is not known; not in the JSON.
        lookalikes: effects that would pass for it if the catalogue did not have them; not in the
            JSON.
    """

    effect: str
    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    confidence: float
    parameters: tuple[Estimate, ...]
    gap_after: float
    indistinguishable_from: tuple[str, ...]
    gaps_after: Mapping[str, float] = field(default_factory=dict)
    equivalent: tuple[tuple[str, str], ...] = ()
    share: float = np.nan
    lookalikes: tuple[str, ...] = ()

    @property
    def determined(self) -> bool:
        """Whether the recordings say how large any of its numbers is."""
        return any(estimate.std for estimate in self.parameters)


@dataclass(frozen=True, kw_only=True)
class Considered:
    """A candidate of one round of the naming.

    Attributes:
        round: 1 for ordinary effects, each against a fit without it; 2 for others beside these, 3
            for pairs of others, and so on.
        effect: its name.
        improvement: relative reduction of the gaps of the fitted recordings that it brings
            (geometric mean over the scored channels), 0.3 for gaps that are 30 % smaller.
        verdict: `named`, `indistinguishable` or `lost`.
    """

    round: int
    effect: str
    improvement: float
    verdict: Literal["named", "indistinguishable", "lost"]


@dataclass(frozen=True, kw_only=True)
class Rival:
    """What the robot may have instead, for all that the recordings tell.

    Attributes:
        effect: what is in the place of a named effect.
        in_place_of: that effect.
        effects: all that the robot has then, as fitted with it; not sure of anything.
    """

    effect: str
    in_place_of: str
    effects: tuple[NamedEffect, ...]


@dataclass(frozen=True, kw_only=True)
class NextExperiment:
    """The excitation that would best tell the members of a confusion set apart.

    Attributes:
        excitation: its name in `walkerkit.tasks.excitation`, or `release`; of a robot on its feet
            in `walkerkit.gap.standing.motions`.
        between: the effects.
        separation: predicted difference of the nearest two, in standard deviations of what the
            explanation leaves.
        file: name of the target file that was written, or None.
        set_up: what is changed of the robot, `as_it_is` for nothing.
        instruction: the same in sentences, empty for nothing.
        model: name of the model file with the changed set-up, or None where nothing of it changes.
    """

    excitation: str
    between: tuple[str, ...]
    separation: float
    file: str | None = None
    set_up: str = "as_it_is"
    instruction: str = ""
    model: str | None = None


@dataclass(frozen=True, kw_only=True)
class Hint:
    """A stopgap where no effect of the catalogue fits: it shrinks the gap and explains nothing.

    Attributes:
        kind: `formula` for the effort that is missing, or `learned` for a network as a drive.
        joint: where.
        title: what it is, e.g. `sparse formula at knee`.
        statement: the formula, or what was learned, in a line.
        signal: whose held-out gap the sizes are, or `missing_effort`.
        size: that gap without it and with it.
        use: code to copy, or "".
        file: name of the file that was written, or None.
    """

    kind: Literal["formula", "learned"]
    joint: str
    title: str
    statement: str
    signal: str
    size: GapSize
    use: str = ""
    file: str | None = None


@dataclass(frozen=True, kw_only=True)
class Trace:
    """One joint of one recording, to be looked at.

    Attributes:
        recording, joint, signal: what it shows.
        unit: unit of the values.
        held_out: whether the recording was held out.
        time: (n,) [s].
        measured, before, after: (n,) each, simulated with the model as given and as mended.
        target: (n,) what was commanded, in the same unit, or None.
        restarts: indices of the samples at which the simulation starts again from the measured
            state; none of a whole rollout.
    """

    recording: str
    joint: str
    signal: str
    unit: str
    held_out: bool
    time: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    target: FloatArray | None = None
    restarts: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The result of the workflow.

    Attributes:
        verdict: `no_gap`, `explained`, `partly_explained` or `unexplained`.
        gap: how large the gap was, is, and can at best be.
        locations: where the gap was, largest first.
        remaining: where the gap is that the named effects leave.
        effects: what was added, in order.
        considered: every candidate of every round.
        next_experiment: what to record next, where names could not be told apart.
        obstacle: why none can be proposed for such a robot, a sentence or ""; not in the JSON.
        recordings: names of the recordings.
        notes: what a reader should know before trusting the numbers.
        traces: measured and simulated signals.
        motions: how the robots moved, of each recording its worst part; not in the JSON.
        seconds: wall time.
        searched: whether effects were looked for, or the gap was only measured.
        only: the effects that were looked for, where it was not the whole catalogue.
        held_out: names of the recordings, or of the parts of them, that no fit has seen.
        maps: where the gap of each signal lives, before and after; not in the JSON.
        hints: stopgaps for what remains.
        wiring: errors of wiring that were mended in the recordings before all else.
        unknown: the weight of structures with an effort that the catalogue cannot name; None where
            it is not known.
        rivals: what the robot may have instead of one of the effects.
    """

    verdict: Verdict
    gap: Gap
    locations: tuple[Location, ...]
    remaining: tuple[Location, ...]
    effects: tuple[NamedEffect, ...]
    considered: tuple[Considered, ...]
    next_experiment: NextExperiment | None
    recordings: tuple[str, ...]
    notes: tuple[str, ...]
    traces: tuple[Trace, ...] = field(repr=False)
    seconds: float
    searched: bool = True
    only: tuple[str, ...] | None = None
    held_out: tuple[str, ...] = ()
    maps: tuple[GapMap, ...] = field(default=(), repr=False)
    obstacle: str = ""
    hints: tuple[Hint, ...] = ()
    wiring: tuple[WiringError, ...] = ()
    unknown: float | None = None
    motions: tuple[Motion, ...] = field(default=(), repr=False)
    rivals: tuple[Rival, ...] = field(default=(), repr=False)

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json, schema 2."""
        gap = self.gap
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "unknown": self.unknown,
            **({"wiring": [_wiring(error) for error in self.wiring]} if self.wiring else {}),
            "gap": {
                "unit": gap.position.unit,
                "horizon": gap.horizon,
                "before": gap.position.before,
                "after": gap.position.after,
                "noise_floor": gap.position.noise_floor,
                "numerical_floor": gap.position.numerical_floor,
                "held_out": gap.held_out,
                "joints": {
                    name: {
                        "before": size.before,
                        "after": size.after,
                        "noise_floor": size.noise_floor,
                    }
                    for name, size in gap.joints.items()
                },
                "signals": {
                    name: {
                        "unit": size.unit,
                        "before": size.before,
                        "after": size.after,
                        "noise_floor": size.noise_floor,
                    }
                    for name, size in gap.signals.items()
                },
            },
            "locations": [
                {
                    "joint": at.joint,
                    "regime": at.regime,
                    "signal": at.signal,
                    "share": at.share,
                    "lift": at.lift,
                }
                for at in self.locations
            ],
            "effects": [_effect(named) for named in self.effects],
            **self._correlation(),
            **({"rivals": [_rival(rival) for rival in self.rivals]} if self.rivals else {}),
            "next_experiment": _next_experiment(self.next_experiment),
            **({"hints": [_hint(hint) for hint in self.hints]} if self.hints else {}),
            "recordings": list(self.recordings),
            "held_out": list(self.held_out),
            "searched": self.searched,
            **({"only": list(self.only)} if self.only is not None else {}),
            "notes": list(self.notes),
            "seconds": self.seconds,
        }

    def _correlation(self) -> dict[str, Any]:
        numbers = [of for named in self.effects for of in named.parameters]
        if not numbers or any(len(of.correlation) != len(numbers) for of in numbers):
            return {}
        return {"correlation": [list(of.correlation) for of in numbers]}

    def to_json(self) -> str:
        """diagnosis.json; numbers carry six significant digits."""
        return json_text(self.to_dict())


def _next_experiment(wanted: NextExperiment | None) -> dict[str, Any] | None:
    if wanted is None:
        return None
    changed = {
        "set_up": wanted.set_up,
        "instruction": wanted.instruction,
        "model": wanted.model,
    }
    return {
        "excitation": wanted.excitation,
        "between": list(wanted.between),
        "separation": wanted.separation,
        "file": wanted.file,
        **(changed if wanted.instruction else {}),
    }


def _wiring(error: WiringError) -> dict[str, Any]:
    return {
        "kind": error.kind,
        "joints": list(error.joints),
        "columns": list(error.columns),
        "gap_before": error.gap_before,
        "gap_after": error.gap_after,
        "unit": error.unit,
        "recordings": list(error.recordings),
        **({"or_else": list(error.or_else)} if error.or_else else {}),
    }


def _rival(rival: Rival) -> dict[str, Any]:
    return {
        "effect": rival.effect,
        "in_place_of": rival.in_place_of,
        "effects": [
            {key: of[key] for key in ("effect", "joints", "bodies", "parameters") if key in of}
            for of in map(_effect, rival.effects)
        ],
    }


def _effect(named: NamedEffect) -> dict[str, Any]:
    bodies = {"bodies": list(named.bodies)} if named.bodies else {}
    place = "body" if named.bodies else "joint"
    return {
        "effect": named.effect,
        "joints": list(named.joints),
        **bodies,
        "confidence": named.confidence,
        "parameters": [
            {
                "name": estimate.name,
                place: estimate.place,
                "value": estimate.value,
                "std": estimate.std,
                "unit": estimate.unit,
                "was": estimate.was,
                "is": estimate.now,
                "field": estimate.field,
                **({"each": [_change(c) for c in estimate.changes]} if estimate.differs else {}),
                "lower": estimate.lower,
                "upper": estimate.upper,
                "at_bound": estimate.at_bound,
            }
            for estimate in named.parameters
        ],
        "gap_after": named.gap_after,
        "indistinguishable_from": list(named.indistinguishable_from),
        **({"reasons": dict(named.equivalent)} if named.equivalent else {}),
    }


def _same(numbers: list[float | None]) -> float | None:
    return numbers[0] if numbers and all(one == numbers[0] for one in numbers) else None


def _change(change: Change) -> dict[str, Any]:
    return {
        "model": change.model,
        "place": change.place,
        "was": change.was,
        "is": change.now,
    }


def _hint(hint: Hint) -> dict[str, Any]:
    return {
        "kind": hint.kind,
        "joint": hint.joint,
        "statement": hint.statement,
        "signal": hint.signal,
        "unit": hint.size.unit,
        "before": hint.size.before,
        "after": hint.size.after,
        "held_out": True,
        "file": hint.file,
    }


def json_text(content: Mapping[str, Any]) -> str:
    """A file of JSON; numbers carry six significant digits, and what is not finite is null."""
    return json.dumps(_rounded(content), indent=2, ensure_ascii=False) + "\n"


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value
