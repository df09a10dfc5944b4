"""A diagnosis as one HTML file that needs no network.

    write_report(diagnosis, "out/report.html", title="leg.xml", catalogue=CATALOGUE)

The same diagnosis gives the same bytes, but for its `seconds`. The page carries plotly.js (some
5 MB) and a content security policy that lets its own scripts run and nothing be fetched, so that
neither a library nor a name in the user's files can change that.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import plotly.offline

from walkerkit.gap.effects import Effect
from walkerkit.gap.report import figures, wording
from walkerkit.gap.report.diagnosis import Considered, Diagnosis, GapSize, NamedEffect, Trace
from walkerkit.gap.report.locate import EVERYWHERE as EVERY_REGIME
from walkerkit.gap.report.quantity import percent, quantity

_ASSETS = files("walkerkit.gap.report") / "assets"
_SHOWN = 8  # candidates of a round that are not folded away
_VERDICTS = {"named": "named", "indistinguishable": "cannot be told apart", "lost": "lost"}


def write_report(
    diagnosis: Diagnosis,
    path: str | Path,
    *,
    title: str,
    catalogue: Mapping[str, Effect] | None = None,
) -> None:
    """Writes the report.

    Args:
        diagnosis: the result.
        path: the HTML file; an existing one is replaced.
        title: heading of the page, e.g. the model's name.
        catalogue: where the equations of the named effects are looked up; None leaves them out.

    Raises:
        OSError: the file cannot be written.
    """
    plotly_js = plotly.offline.get_plotlyjs()
    page_js = _asset("report.js")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(_asset("report.html.j2")).render(
        _content(diagnosis, catalogue or {}),
        title=wording.label(title),
        style=_asset("report.css"),
        plotly_js=plotly_js,
        page_js=page_js,
        script_hashes=[_hash(plotly_js), _hash(page_js)],
    )
    Path(path).write_bytes(page.encode())


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """The script's name in a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def _content(diagnosis: Diagnosis, catalogue: Mapping[str, Effect]) -> dict[str, Any]:
    traces = sorted(diagnosis.traces, key=lambda trace: not trace.held_out)  # stable
    return {
        "diagnosis": diagnosis,
        "verdict": wording.TITLES[diagnosis.verdict],
        "sentence": _tight(wording.verdict_sentence(diagnosis)),
        "basis": wording.basis(diagnosis.gap),
        "headline": _headline(diagnosis),
        "sizes": _sizes(diagnosis),
        "estimates": [_estimates(named) for named in diagnosis.effects],
        "explanations": [
            _explanation(catalogue[name])
            for name in dict.fromkeys(named.effect for named in diagnosis.effects)
            if name in catalogue
        ],
        "warnings": wording.warnings(diagnosis),
        "rounds": _rounds(diagnosis.considered),
        "doubts": wording.doubts(diagnosis),
        "advice": wording.advice(diagnosis),
        "notes": [wording.label(note) for note in diagnosis.notes],
        "recordings": [wording.label(name) for name in diagnosis.recordings],
        "choices": _choices(diagnosis, traces),
        "figures": _figures(diagnosis),
        "traces": [
            figures.comparison_choice(trace, _floor(diagnosis, trace), bool(diagnosis.effects))
            for trace in traces
        ],
    }


def _tight(text: str) -> str:
    """The text with numbers that no line break parts from their units."""
    return re.sub(r"(?<=\d) (?=%|\w)", "\N{NO-BREAK SPACE}", text)


def _headline(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    signal, size = wording.telling(diagnosis.gap)
    numbers = [(f"{wording.words(signal)} error", size.before)]
    if diagnosis.effects:
        numbers = [(f"{wording.words(signal)} error before", size.before), ("after", size.after)]
    numbers.append(("noise floor", size.noise_floor))
    return [(name, quantity(value, size.unit)) for name, value in numbers]


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
        "confidence": percent(named.confidence),
        "sites": wording.listed([wording.site(name) for name in named.joints or named.bodies]),
        "parameters": [
            (wording.site(of.place), wording.label(of.name), *wording.estimate(of))
            for of in named.parameters
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
        ones.sort(key=lambda one: (one.verdict != "named", -_comparable(one.improvement)))
        best = ones[0].improvement
        largest = max(1e-12, *(_comparable(one.improvement) for one in ones))
        rows = [
            {
                "effect": wording.label(one.effect),
                "improvement": percent(one.improvement)
                if math.isfinite(one.improvement)
                else "diverged",
                "bar": f"{100 * max(0.0, _comparable(one.improvement)) / largest:.1f}",
                "behind": _behind(best - one.improvement) if one is not ones[0] else "",
                "kind": one.verdict,
                "verdict": _VERDICTS[one.verdict],
            }
            for one in ones
        ]
        rounds.append({"index": index, "shown": rows[:_SHOWN], "folded": rows[_SHOWN:]})
    return rounds


def _comparable(improvement: float) -> float:
    return improvement if math.isfinite(improvement) else -math.inf


def _behind(points: float) -> str:
    if not math.isfinite(points):
        return ""
    return percent(points).removesuffix(" %")


def _choices(diagnosis: Diagnosis, traces: Sequence[Trace]) -> list[tuple[str, list[Any]]]:
    """What can be looked at, held-out recordings first; chosen is the joint of the largest gap."""
    worst = max(diagnosis.locations, key=lambda at: at.share).joint if diagnosis.locations else ""
    chosen = next(
        (i for i, t in enumerate(traces) if t.joint == worst and t.held_out == traces[0].held_out),
        0,
    )
    groups: dict[str, list[Any]] = {}
    for index, trace in enumerate(traces):
        option = f"{trace.recording}: {trace.joint}, {wording.words(trace.signal)}"
        group = groups.setdefault("held out" if trace.held_out else "fitted", [])
        group.append((wording.label(option), index == chosen))
    return list(groups.items())


def _floor(diagnosis: Diagnosis, trace: Trace) -> GapSize | None:
    return diagnosis.gap.joints.get(trace.joint) if trace.signal == "position" else None


def _figures(diagnosis: Diagnosis) -> dict[str, figures.Specification]:
    """Every figure by the identifier of its place in the page."""
    found = {"steps": figures.steps(diagnosis)}
    remaining = diagnosis.remaining if diagnosis.effects else ()
    places = [*diagnosis.locations, *remaining]
    joints = list(dict.fromkeys([*diagnosis.gap.joints, *(at.joint for at in places)]))
    regimes = list(dict.fromkeys(at.regime for at in places))
    regimes.sort(key=lambda name: name == EVERY_REGIME)  # stable: last, as a sum would be
    if diagnosis.locations:
        found["located"] = figures.heat_map(diagnosis.locations, joints, regimes)
    if remaining:
        found["remaining"] = figures.heat_map(remaining, joints, regimes)
    if diagnosis.traces:
        found["comparison"] = figures.comparison(bool(diagnosis.effects))
    return found
