"""A diagnosis as one HTML file that needs no network.

    write_report(diagnosis, "out/report.html", title="leg.xml", catalogue=CATALOGUE)

The same diagnosis gives the same bytes, but for its `seconds`; they are at most `html.MOST`, to
which end long recordings are drawn more coarsely.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from walkerkit.gap.effects import Effect
from walkerkit.gap.report import figures, wording
from walkerkit.gap.report.changes import changes
from walkerkit.gap.report.diagnosis import Considered, Diagnosis, Hint, NamedEffect, Trace
from walkerkit.gap.report.gaps import Location
from walkerkit.gap.report.heat import HeatMap, heat_map
from walkerkit.gap.report.html import MOST, page, write_html
from walkerkit.gap.report.page_budget import Fitted, fitted
from walkerkit.gap.report.poses import drawn
from walkerkit.gap.report.quantity import percent, quantity, span
from walkerkit.gap.report.samples import POINTS

_SHOWN = 6  # candidates of a round that have a line of their own
_PLACES = 5  # that stand out
_ROUNDS = {1: "Ordinary effects, each against a fit without it", 2: "One other effect beside them"}
_VERDICTS = {"named": "named", "indistinguishable": "cannot be told apart", "lost": "lost"}


def write_report(
    diagnosis: Diagnosis,
    path: str | Path,
    *,
    title: str,
    catalogue: Mapping[str, Effect] | None = None,
    models: Sequence[str] = ("model.xml",),
    experiments: str = "",
) -> None:
    """Writes the report.

    Args:
        diagnosis: the result.
        path: the HTML file; an existing one is replaced.
        title: heading of the page, e.g. the model's name.
        catalogue: where the equations of the named effects are looked up; None leaves them out.
        models: names of the mended models that lie beside the report; none where nothing does.
        experiments: an experiments.toml to diagnose again with the next experiment, or "".

    Raises:
        OSError: the file cannot be written.
    """
    content = {
        **_content(diagnosis, catalogue or {}),
        "title": wording.label(title),
        "models": [wording.label(name) for name in models],
        "experiments": experiments,
    }
    traces = _ordered(diagnosis)
    every = Fitted(data={}, points=POINTS, traces=0, motions=0)  # the longest sentences
    bare = page("report.html.j2", **content, **_drawn(diagnosis, traces, every))
    found = fitted(diagnosis, traces, MOST - len(bare.encode()))
    write_html(path, "report.html.j2", **content, **_drawn(diagnosis, traces, found))


def _content(diagnosis: Diagnosis, catalogue: Mapping[str, Effect]) -> dict[str, Any]:
    traces = _ordered(diagnosis)
    return {
        "diagnosis": diagnosis,
        "verdict": wording.title(diagnosis),
        "sentence": wording.tight(wording.verdict_sentence(diagnosis)),
        "unknown": wording.unknown(diagnosis),
        "unknown_weight": 100 * (diagnosis.unknown or 0.0),
        "basis": wording.tight(wording.basis(diagnosis)),
        "wiring": wording.wiring(diagnosis),
        "headline": _headline(diagnosis),
        "maps": _maps(diagnosis),
        "places": _places(diagnosis),
        "places_of": wording.words(next((at.signal for at in diagnosis.locations), "position")),
        "sizes": _sizes(diagnosis),
        "estimates": [_estimates(named) for named in diagnosis.effects],
        "changes": changes(diagnosis),
        "explanations": [
            _explanation(catalogue[name])
            for name in dict.fromkeys(named.effect for named in diagnosis.effects)
            if name in catalogue
        ],
        "values": wording.VALUES,
        "sure": wording.SURE,
        "warnings": wording.warnings(diagnosis),
        "rounds": _rounds(diagnosis.considered),
        "doubts": [wording.tight(doubt) for doubt in wording.doubts(diagnosis)],
        "advice": wording.tight(wording.advice(diagnosis)),
        "hints": [_hint(hint) for hint in diagnosis.hints],
        "notes": [wording.tight(wording.label(note)) for note in diagnosis.notes],
        "recordings": [wording.label(name) for name in diagnosis.recordings],
        "choices": _choices(diagnosis, traces),
        "figures": _figures(diagnosis),
        "moving_in": wording.label(diagnosis.motions[0].recording) if diagnosis.motions else "",
        "poses": drawn(diagnosis.motions[0], mended=bool(diagnosis.effects))
        if diagnosis.motions
        else [],
    }


def _ordered(diagnosis: Diagnosis) -> list[Trace]:
    """The signals, held-out recordings first."""
    return sorted(diagnosis.traces, key=lambda trace: not trace.held_out)  # stable


def _drawn(diagnosis: Diagnosis, traces: Sequence[Trace], found: Fitted) -> dict[str, Any]:
    """What is drawn, and a sentence on what had no room."""
    said = []
    if found.points:
        said.append(f"Signals are drawn with about {found.points} samples each")
    if found.traces < len(traces):
        said.append(f"{found.traces} of {len(traces)} signals are drawn")
    if found.motions < len(diagnosis.motions):
        said.append(f"the robot moves in {found.motions} of {len(diagnosis.motions)} recordings")
    room = ""
    if said:
        limit = f"{MOST / 1e6:g} MB"
        room = (
            f"{wording.listed(said)}, so that this page has no more than {limit}; "
            "--traces FILE writes every sample."
        )
    return {"data": found.data, "room": room[:1].upper() + room[1:]}


def _headline(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    signal, size = wording.telling(diagnosis.gap)
    numbers = [(f"{wording.words(signal)} error", size.before)]
    if diagnosis.effects:
        numbers = [(f"{wording.words(signal)} error before", size.before), ("after", size.after)]
    numbers += [("noise floor", size.noise_floor), ("numerical floor", size.numerical_floor)]
    return [(name, quantity(value, size.unit)) for name, value in numbers]


def _maps(diagnosis: Diagnosis) -> list[HeatMap]:
    """The map of the signal that tells first."""
    first, _ = wording.telling(diagnosis.gap)
    found = []
    for of in sorted(diagnosis.maps, key=lambda of: of.signal != first):
        size = wording.signals(diagnosis.gap).get(of.signal)
        floor = 0.0 if size is None else size.floor
        heat = heat_map(of, floor, mended=bool(diagnosis.effects))
        if heat is not None:
            found.append(heat)
    return found


def _places(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Where the gap stands out: the place, its share, its lift."""
    if diagnosis.verdict == "no_gap":
        return []
    return [
        (wording.spot(at), percent(at.share), f"{at.lift:.1f}×")
        for at in diagnosis.locations[:_PLACES]
    ]


def _sizes(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The table of gaps, its head first."""
    gap = diagnosis.gap
    sizes = {f"{wording.words(n)}, all joints": size for n, size in wording.signals(gap).items()}
    sizes |= {f"position, {wording.label(n)}": size for n, size in gap.joints.items()}
    return [
        ("gap", *wording.size_columns(diagnosis)),
        *((name, *wording.size_cells(diagnosis, size)) for name, size in sizes.items()),
    ]


def _estimates(named: NamedEffect) -> dict[str, Any]:
    return {
        "effect": wording.label(named.effect),
        "confidence": wording.sure(named.confidence),
        "sites": wording.listed([wording.site(name) for name in named.joints or named.bodies]),
        "parameters": [
            {
                "place": wording.site(of.place),
                "name": wording.label(of.name),
                "value": value,
                "unit": unit,
                "warning": warning,
                "interval": wording.interval(of),
                "range": " to ".join(span((of.lower, of.upper), of.unit))
                if math.isfinite(of.upper - of.lower)
                else "",
            }
            for of in named.parameters
            for value, unit, warning in [wording.estimate(of)]
        ],
    }


def _explanation(effect: Effect) -> dict[str, str]:
    return {
        "name": effect.name,
        "equation": effect.equation,
        "symptom": effect.symptom,
        "added_as": effect.added_as,
    }


def _rounds(considered: Sequence[Considered]) -> list[dict[str, Any]]:
    rounds = []
    for index in sorted({one.round for one in considered}):
        ones = [one for one in considered if one.round == index]
        ones.sort(key=_standing)
        shown = max(_SHOWN, sum(one.verdict != "lost" for one in ones))
        rows = [
            {
                "effect": wording.label(one.effect),
                "improvement": percent(one.improvement)
                if math.isfinite(one.improvement)
                else "diverged",
                "bar": f"{100 * max(0.0, _comparable(one.improvement)):.1f}",
                "kind": one.verdict,
                "verdict": _VERDICTS[one.verdict],
            }
            for one in ones
        ]
        rounds.append(
            {
                "title": _ROUNDS.get(index, f"{index - 1} other effects beside them"),
                "named": ones[0].verdict == "named",
                "shown": rows[:shown],
                "others": [f"{row['effect']} ({row['improvement']})" for row in rows[shown:]],
            }
        )
    return rounds


def _standing(one: Considered) -> tuple[bool, bool, float]:
    """What is named first, then what is as good, then by improvement."""
    return one.verdict != "named", one.verdict == "lost", -_comparable(one.improvement)


def _comparable(improvement: float) -> float:
    return improvement if math.isfinite(improvement) else -math.inf


def _hint(hint: Hint) -> dict[str, str]:
    return {
        "title": wording.label(hint.title),
        "statement": wording.label(hint.statement),
        "gap": wording.tight(wording.hint_gap(hint)),
        "use": hint.use,
    }


def _choices(diagnosis: Diagnosis, traces: Sequence[Trace]) -> dict[str, Any] | None:
    """What can be looked at, held-out recordings first; chosen is the joint of the largest gap."""
    if not traces:
        return None
    signal, _ = wording.telling(diagnosis.gap)
    joint = next((at.joint for at in _whole_joints(diagnosis, signal)), "")
    first = max(traces, key=lambda t: (t.held_out, t.signal == signal, t.joint == joint))
    recordings = {t.recording: t.held_out for t in traces}
    return {
        "recordings": [
            (group, [(wording.label(n), n == first.recording) for n in names])
            for group, half in (("held out", True), ("fitted", False))
            if (names := [name for name, held_out in recordings.items() if held_out == half])
        ],
        "joints": [(wording.label(n), n == first.joint) for n in _unique(t.joint for t in traces)],
        "signals": [
            (wording.words(n), n == first.signal) for n in _unique(t.signal for t in traces)
        ],
    }


def _whole_joints(diagnosis: Diagnosis, signal: str) -> list[Location]:
    """The joints by the size of their gap, largest first."""
    cells = next((of.before for of in diagnosis.maps if of.signal == signal), diagnosis.locations)
    return sorted(cells, key=lambda at: -at.share)


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _figures(diagnosis: Diagnosis) -> dict[str, figures.Specification]:
    """Every figure by the identifier of its place in the page."""
    found = {"steps": figures.waterfall(diagnosis)}
    if diagnosis.traces:
        found["comparison"] = figures.comparison(bool(diagnosis.effects))
    return found
