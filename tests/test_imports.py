"""Imports of the library go one way: no circle, and nothing from a layer above."""

from __future__ import annotations

from benchmarks.house import circle, imports, modules, namesakes, upward


def test_there_is_no_circle():
    assert circle(imports(modules())) == []


def test_nothing_is_imported_from_a_layer_above():
    assert upward(imports(modules())) == []


def test_no_two_modules_have_one_name():
    assert namesakes(modules()) == []


def test_a_circle_is_found():
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}


def test_an_import_from_above_is_found():
    graph = {"gap.search.fit": {"gap.simulation.robot", "gap.report.page"}}
    assert upward(graph) == [("gap.search.fit", "gap.report.page")]
