"""The fleet's page and what is printed: names are text, nothing is fetched, links lead on."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from walkerkit.gap.fleet.comparison import compare
from walkerkit.gap.fleet.engine import Failure
from walkerkit.gap.fleet.fleet import Fleet, Outcome
from walkerkit.gap.fleet.fleet_page import write_page

HOSTILE = "<img src=x onerror=\"document.title='pwned'\"> $\\alpha$ [red]"
CHROMIUM = shutil.which("chromium")


def robot(value: float | None, joint: str = "knee", unit: str = "N·m") -> dict[str, Any]:
    """The content of a diagnosis.json with one effect, or without."""
    size = {"unit": "rad", "before": 0.01, "after": 0.002, "noise_floor": 0.0001}
    named = {
        "effect": "torque_bias",
        "joints": [joint],
        "confidence": 0.99,
        "parameters": [
            {"name": "bias", "joint": joint, "value": value, "std": 0.01, "unit": unit}
            | {"at_bound": value == 1.0}
        ],
        "gap_after": 0.002,
        "indistinguishable_from": [],
    }
    return {
        "verdict": "no_gap" if value is None else "explained",
        "gap": {**size, "joints": {joint: size}},
        "effects": [] if value is None else [named],
        "seconds": 2.0,
    }


def fleet(failure: str = "", **diagnoses: Any) -> Fleet:
    outcomes = [Outcome(robot=name, diagnosis=content) for name, content in diagnoses.items()]
    if failure:
        broken = Failure(message=failure, refused=True)
        outcomes.append(Outcome(robot=f"broken {HOSTILE}", diagnosis=None, failure=broken))
    return Fleet(outcomes=tuple(outcomes), comparison=compare(diagnoses))


def written(of: Fleet, folder: Path) -> str:
    write_page(of, folder / "fleet.html", title=HOSTILE)
    return (folder / "fleet.html").read_text(encoding="utf-8")


def test_names_come_out_as_text_and_nothing_is_fetched(tmp_path: Path) -> None:
    strange = {HOSTILE: robot(0.2, HOSTILE), "b / #1": robot(0.3, HOSTILE)}
    text = written(fleet(failure=HOSTILE, **strange), tmp_path)
    page = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert "<img" not in page
    assert "&lt;img src=x" in page
    assert "default-src 'none'" in page
    assert 'href="b%20%2F%20%231/report.html"' in page
    assert re.findall(r'(?:src|href)="(?!#|%3C|b%20)[^"]*"', page) == []
    assert "https://" not in page


def test_robots_effects_and_parameters_side_by_side(tmp_path: Path) -> None:
    of = fleet(a=robot(0.2), b=robot(0.3), c=robot(None), d=robot(1.0), failure="leg.xml: gone.")
    text = written(of, tmp_path)
    for part in (
        *("Most robots have torque_bias at knee.", "Common to most", "3 of 4"),
        *("0.200 ± 0.010 N·m", "0.25 N·m", "⚠ at its bound", "leg.xml: gone.", "No gap"),
    ):
        assert part in text, part
    printed = str(of)
    for part in ("Most robots have torque_bias at knee.", "a 0.200 ± 0.010 N·m;", "at its bound"):
        assert part in " ".join(printed.split()), part
    assert "leg.xml: gone." in printed
    assert "[red]" in printed


@pytest.mark.parametrize(
    ("of", "says"),
    [
        (fleet(failure="leg.xml: gone."), "No robot could be diagnosed."),
        (fleet(a=robot(0.2)), "Only a was diagnosed: there is nothing to compare it with."),
        (fleet(a=robot(None), b=robot(None)), "Nothing was named for any of the 2 robots"),
        (fleet(a=robot(0.1), b=robot(None)), "No effect is common to most robots. a alone has"),
    ],
)
def test_reads_well_with_little_to_say(of: Fleet, says: str, tmp_path: Path) -> None:
    assert says in written(of, tmp_path)
    assert says in str(of)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not on PATH")
def test_a_browser_draws_the_plots_and_runs_no_name(tmp_path: Path) -> None:
    written(fleet(failure=HOSTILE, **{HOSTILE: robot(0.2), "b": robot(0.3)}), tmp_path)
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000")
    done = subprocess.run(
        [str(CHROMIUM), *options, "--dump-dom", (tmp_path / "fleet.html").as_uri()],
        capture_output=True,
        encoding="utf-8",
        timeout=100,
        check=True,
    )
    (title,) = re.findall(r"<title>(.*?)</title>", done.stdout)[:1]
    assert title.startswith("Fleet: &lt;img")
    assert done.stdout.count('class="main-svg"') >= 2
