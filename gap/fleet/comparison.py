"""Which effects the robots of a fleet have in common, and which are one unit's own.

    comparison = compare({"unit-1": json.loads(...), "unit-2": json.loads(...)})
    comparison.rows[0].kind                   # all, most, some or own

It reads nothing but the robots' `diagnosis.json`. An effect counts by its place: dry friction at
the knee and at the hip are two. A robot for which one value serves the whole robot (`*`) has the
effect wherever others have it; a robot without the joint does not count. Where a robot's recordings
cannot tell another effect from this one, it could have this one: it then counts among those
that have it in common, and nobody else's is called its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Literal

from walkerkit.gap.report.diagnosis import Estimate

Shared = Literal["all", "most", "some", "own"]
ORDER: tuple[Shared, ...] = ("all", "most", "some", "own")
_EVERYWHERE = "*"
Key = tuple[str, str]  # effect and place


@dataclass(frozen=True, kw_only=True)
class Row:
    """One effect at one place, over all robots.

    Attributes:
        effect: its name in the catalogue.
        place: joint or body, or `*` for the whole robot.
        body: whether the place is a body.
        shared: by all robots that could have it, by more than half, by some, or one unit's own.
        robots: those that have it.
        possible: those whose recordings cannot tell it from what was named.
        compared: those that have the place.
        parameters: name to robot to its estimate.
    """

    effect: str
    place: str
    body: bool
    shared: Shared
    robots: tuple[str, ...]
    possible: tuple[str, ...]
    compared: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Estimate]]

    def middle(self, parameter: str) -> float:
        """The median of a parameter over the robots that could estimate it; NaN for none."""
        values = [of.value for of in self.parameters[parameter].values() if not of.at_bound]
        return median(values) if values else float("nan")


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What robots have in common.

    Attributes:
        robots: their names.
        rows: what all have first, then most, some, one; in each, what most robots have first.
    """

    robots: tuple[str, ...]
    rows: tuple[Row, ...]

    def of(self, shared: Shared) -> tuple[Row, ...]:
        """The rows of one kind."""
        return tuple(row for row in self.rows if row.shared == shared)

    def own(self, robot: str) -> tuple[Row, ...]:
        """What one robot has alone."""
        return tuple(row for row in self.of("own") if row.robots == (robot,))


@dataclass(frozen=True, kw_only=True)
class _Named:
    """What one robot has of an effect at a place."""

    body: bool
    doubt: tuple[str, ...]
    estimates: tuple[Estimate, ...]


def compare(diagnoses: Mapping[str, Mapping[str, Any]]) -> Comparison:
    """Sets the effects of robots side by side.

    Args:
        diagnoses: robot to the content of its diagnosis.json.
    """
    found = {robot: _named(content["effects"]) for robot, content in diagnoses.items()}
    joints = {robot: set(content["gap"]["joints"]) for robot, content in diagnoses.items()}
    rows = [_row(key, found, joints) for key in _keys(found.values())]
    rows.sort(key=lambda row: (ORDER.index(row.shared), -len(row.robots)))  # stable
    return Comparison(robots=tuple(diagnoses), rows=tuple(rows))


def _named(effects: Iterable[Mapping[str, Any]]) -> dict[Key, _Named]:
    """What a robot has, by effect and place."""
    found = {}
    for one in effects:
        bodies = one.get("bodies", [])
        kind = "body" if bodies else "joint"
        for place in bodies or one["joints"] or [_EVERYWHERE]:
            found[one["effect"], place] = _Named(
                body=bool(bodies),
                doubt=tuple(one["indistinguishable_from"]),
                estimates=tuple(
                    _estimate(of, kind) for of in one["parameters"] if of[kind] == place
                ),
            )
    return found


def _estimate(of: Mapping[str, Any], kind: str) -> Estimate:
    value = float("nan") if of["value"] is None else of["value"]
    return Estimate(
        name=of["name"],
        place=of[kind],
        value=value,
        std=of["std"],
        unit=of["unit"],
        at_bound=of["at_bound"],
    )


def _keys(found: Iterable[Mapping[Key, _Named]]) -> list[Key]:
    """Effects and places, each once; the whole robot only where nobody has it at a place."""
    keys = dict.fromkeys(key for named in found for key in named)
    placed = {effect for effect, place in keys if place != _EVERYWHERE}
    return [key for key in keys if key[1] != _EVERYWHERE or key[0] not in placed]


def _row(
    key: Key, found: Mapping[str, Mapping[Key, _Named]], joints: Mapping[str, set[str]]
) -> Row:
    effect, place = key
    has = {robot: one for robot, named in found.items() if (one := _at(named, effect, place))}
    body = any(one.body for one in has.values())
    anywhere = body or place == _EVERYWHERE
    compared = [robot for robot in found if anywhere or place in joints[robot] or robot in has]
    possible = [
        robot
        for robot in compared
        if robot not in has
        and any(effect in one.doubt for one in _all_at(found[robot], place).values())
    ]
    parameters: dict[str, dict[str, Estimate]] = {}
    for robot, one in has.items():
        for of in one.estimates:
            parameters.setdefault(of.name, {})[robot] = of
    return Row(
        effect=effect,
        place=place,
        body=body,
        shared=_shared(has, possible, compared, found, place),
        robots=tuple(has),
        possible=tuple(possible),
        compared=tuple(compared),
        parameters=parameters,
    )


def _shared(
    has: Mapping[str, _Named],
    possible: Sequence[str],
    compared: Sequence[str],
    found: Mapping[str, Mapping[Key, _Named]],
    place: str,
) -> Shared:
    count = len(has) + len(possible)
    if count > 1:
        if count == len(compared):
            return "all"
        return "most" if 2 * count > len(compared) else "some"
    ((robot, one),) = has.items()
    others = (_all_at(found[other], place) for other in compared if other != robot)
    return "some" if any(name in named for named in others for name in one.doubt) else "own"


def _at(named: Mapping[Key, _Named], effect: str, place: str) -> _Named | None:
    return named.get((effect, place)) or named.get((effect, _EVERYWHERE))


def _all_at(named: Mapping[Key, _Named], place: str) -> dict[str, _Named]:
    """What a robot has at a place, by effect."""
    return {effect: one for (effect, at), one in named.items() if at in (place, _EVERYWHERE)}
