"""Which effects are common, and which are one unit's own."""

from __future__ import annotations

import math
from typing import Any

from walkerkit.gap.fleet.comparison import Comparison, Row, compare


def effect(
    name: str, *places: str, doubt: tuple[str, ...] = (), body: bool = False, **values: Any
) -> dict[str, Any]:
    """One effect of a diagnosis.json, with the same values at each place."""
    kind = "body" if body else "joint"
    return {
        "effect": name,
        "joints": [] if body else list(places),
        **({"bodies": list(places)} if body else {}),
        "confidence": 0.9,
        "parameters": [
            {"name": key, kind: place, "value": value, "std": 0.1, "unit": "1", "at_bound": False}
            for place in places
            for key, value in values.items()
        ],
        "gap_after": 0.001,
        "indistinguishable_from": list(doubt),
    }


def diagnosis(*effects: dict[str, Any], joints: tuple[str, ...] = ("hip", "knee")) -> Any:
    return {"effects": list(effects), "gap": {"joints": dict.fromkeys(joints)}}


def row(found: Comparison, name: str, place: str) -> Row:
    (one,) = (row for row in found.rows if (row.effect, row.place) == (name, place))
    return one


def test_from_common_to_one_units_own() -> None:
    friction = effect("coulomb_friction", "knee", frictionloss=0.1)
    found = compare(
        {
            "a": diagnosis(effect("backlash", "hip"), effect("armature", "knee"), friction),
            "b": diagnosis(effect("armature", "knee"), friction),
            "c": diagnosis(effect("armature", "knee"), friction, effect("cogging", "knee")),
            "d": diagnosis(friction, effect("cogging", "knee")),
        }
    )
    assert [(row.effect, row.shared, row.robots) for row in found.rows] == [
        ("coulomb_friction", "all", ("a", "b", "c", "d")),
        ("armature", "most", ("a", "b", "c")),
        ("cogging", "some", ("c", "d")),
        ("backlash", "own", ("a",)),
    ]
    assert [row.effect for row in found.own("a")] == ["backlash"]
    assert found.own("b") == ()


def test_places_count_apart_and_one_value_for_all_counts_everywhere() -> None:
    found = compare(
        {
            "a": diagnosis(effect("command_delay", "*", delay=0.01)),
            "b": diagnosis(effect("command_delay", "hip", "knee", delay=0.02)),
            "c": diagnosis(effect("command_delay", "knee", delay=0.03)),
        }
    )
    assert row(found, "command_delay", "knee").shared == "all"
    assert row(found, "command_delay", "hip").robots == ("a", "b")
    assert len(found.rows) == 2
    values = row(found, "command_delay", "knee").parameters["delay"]
    assert {robot: one.value for robot, one in values.items()} == {"a": 0.01, "b": 0.02, "c": 0.03}
    assert row(found, "command_delay", "knee").middle("delay") == 0.02
    alone = compare({"a": diagnosis(effect("base_tilt", "*")), "b": diagnosis()})
    assert row(alone, "base_tilt", "*").shared == "own"


def test_a_robot_without_the_joint_does_not_count() -> None:
    found = compare(
        {
            "a": diagnosis(effect("armature", "wrist"), joints=("wrist",)),
            "b": diagnosis(effect("armature", "wrist"), joints=("wrist",)),
            "c": diagnosis(joints=("knee",)),
        }
    )
    assert row(found, "armature", "wrist").shared == "all"
    assert row(found, "armature", "wrist").compared == ("a", "b")


def test_what_cannot_be_told_apart_is_nobodys_own() -> None:
    doubtful = effect("sensor_delay", "knee", doubt=("command_delay",))
    sure = diagnosis(effect("command_delay", "knee"))
    found = compare({"a": diagnosis(doubtful), "b": sure, "c": sure})
    common = row(found, "command_delay", "knee")
    assert (common.shared, common.robots, common.possible) == ("all", ("b", "c"), ("a",))
    assert row(found, "sensor_delay", "knee").shared == "some"


def test_bodies_bounds_and_numbers_that_are_none() -> None:
    heavy = diagnosis(effect("payload", "shin", body=True, mass=0.5))
    bound = diagnosis(effect("payload", "shin", body=True, mass=2.0))
    bound["effects"][0]["parameters"][0] |= {"at_bound": True, "std": None}
    lost = diagnosis(effect("payload", "shin", body=True, mass=None))
    found = compare({"a": heavy, "b": bound})
    one = row(found, "payload", "shin")
    assert one.body
    assert one.middle("mass") == 0.5
    assert math.isnan(compare({"a": lost}).rows[0].middle("mass"))
    assert compare({}).rows == ()
