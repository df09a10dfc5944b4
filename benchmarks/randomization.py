"""Whether draws of `randomization.py` are robots that leave the recordings as they are.

    python -m benchmarks randomization            # real logs and rehearsals of our leg
    python -m benchmarks randomization --quick    # one of each

A log is diagnosed, and the numbers of the mended model are drawn as a trainer would draw them. Each
draw is a model of its own, which replays the held-out recordings.
"""

from __future__ import annotations

import copy
import json
import runpy
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import Row
from benchmarks.rivals.logs import LOGS
from walkerkit import gap
from walkerkit.gap import Recording
from walkerkit.gap.deliver import apply, export
from walkerkit.gap.deliver.findings import DIAGNOSIS, read_findings
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.walkers import LEG_XML

DRAWS = 40
TIMES = 2.0  # the gap of the mended model
_REAL = ("go2_leg", "double_pendulum")
_HIDDEN = ("viscous_friction", "payload", "command_delay", "stribeck_friction", "effort_limit")
Key = tuple[str, str, str]


@dataclass(frozen=True, kw_only=True)
class _Log:
    name: str
    model: Path
    fitted: Sequence[Recording]
    held_out: Sequence[Recording]


def run(*, quick: bool) -> list[Row]:
    """The part of the draws that reproduce their log, for each log."""
    return [
        _row(log) for logs in (_real, _rehearsed) for log in ([*logs()][:1] if quick else logs())
    ]


def _real() -> Iterator[_Log]:
    for log in LOGS:
        if log.name in _REAL:
            (one,) = log.experiments()
            held = [r for r in one.recordings if r.name in one.held_out]
            fitted = [r for r in one.recordings if r.name not in one.held_out]
            yield _Log(name=log.name, model=Path(one.model), fitted=fitted, held_out=held)


def _rehearsed() -> Iterator[_Log]:
    for name in _HIDDEN:
        *fitted, last = rehearse(LEG_XML, [name], seed=1).recordings
        yield _Log(name=f"leg, {name}", model=LEG_XML, fitted=fitted, held_out=[last])


def _row(log: _Log) -> Row:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "result"
        result = gap.diagnose(log.model, log.fitted, held_out=log.held_out, allow_outside=True)
        result.save(folder)
        found = read_findings(folder)
        drawn = runpy.run_path(str(export(folder, "warp").folder / "randomization.py"))
        numbers = drawn["draw"](np.random.default_rng(0), DRAWS)
        gaps = np.empty(DRAWS)
        for k in range(DRAWS):
            by = {key: float(numbers[key][k] - drawn["MEAN"][i]) for i, key in enumerate(numbers)}
            (folder / DIAGNOSIS).write_text(_changed(found.content, by))
            gaps[k] = _gap(log, folder)
    own = result.diagnosis.gap.position.after
    within = float(np.mean(gaps <= TIMES * own))
    effects = ", ".join(effect["effect"] for effect in found.effects)
    print(f"{log.name}: {effects}: {len(numbers)} numbers, {1e3 * own:.3g} mrad", flush=True)
    return Row(
        what=f"draws within {TIMES:g} times the gap, {log.name}",
        result=f"{within:.0%} of {DRAWS} with {len(numbers)} numbers; of the gap the median is "
        f"{np.median(gaps) / own:.2f}, the largest {gaps.max() / own:.2f}",
        reference=f"{1e3 * own:.3g} mrad",
        required="95 %",
    )


def _changed(content: Mapping[str, Any], by: Mapping[Key, float]) -> str:
    """A diagnosis.json with other numbers."""
    changed: dict[str, Any] = copy.deepcopy(dict(content))
    for effect in changed["effects"]:
        for number in effect["parameters"]:
            place = number.get("joint", number.get("body", "*"))
            change = by.get((effect["effect"], place, number["name"]), 0.0)
            number["value"] += change
            for one in (number, *number.get("each", ())):
                if one["is"] is not None:
                    one["is"] += change
    return json.dumps(changed)


def _gap(log: _Log, folder: Path) -> float:
    path = folder / "drawn" / "drawn.xml"
    apply(folder, log.model, out=path, overwrite=True, allow_outside=True)
    compared = gap.compare(path, log.fitted, held_out=log.held_out, allow_outside=True)
    return compared.gap.position.before
