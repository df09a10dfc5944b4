"""Every code block of the README and of the larger pages runs, in its order, in one folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import pages
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.report.wording import VALUES
from walkerkit.walkers.leg import LEG_XML

# What stands in for the leg of `make demo`: one joint, so that the whole catalogue is quick.
SHANK = """
<mujoco model="leg">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="shank">
      <joint name="calf" axis="0 1 0" armature="0.005" damping="0.1" range="-1 1" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position joint="calf" kp="30" kv="1" forcerange="-20 20"/></actuator>
</mujoco>
"""


def test_every_block_runs(repository: Path, tmp_path: Path) -> None:
    blocks = pages.runnable(repository / "README.md")
    assert len(blocks) >= 4
    # The README goes on with what `make demo` leaves behind.
    (tmp_path / "walkerkit-demo").mkdir()
    (tmp_path / "walkerkit-demo/leg.xml").write_text(SHANK, encoding="utf-8")
    hidden = "--hide viscous_friction --seconds 1"
    demo = f"walkerkit simulate walkerkit-demo/leg.xml {hidden} --out walkerkit-demo/recordings"
    pages.run([("bash", demo), *blocks], tmp_path)


def test_is_read_in_a_few_minutes(repository: Path) -> None:
    assert len((repository / "README.md").read_text(encoding="utf-8").split()) <= 1500


def test_shows_what_the_command_prints(repository: Path) -> None:
    """Word for word; numbers may differ in their last digits from machine to machine."""
    (shown,) = re.findall(
        r"^```text\n(Explained.*?)^```$",
        (repository / "README.md").read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    # As `walkerkit demo` records it. That the whole catalogue ends with this effect takes minutes.
    recordings = rehearse(LEG_XML, seed=0).recordings
    found = gap.diagnose(LEG_XML, recordings, effects=["viscous_friction"])
    printed = f"{found}\ndiagnosis/report.html"
    assert words(shown) == words(printed)


def words(text: str) -> list[str]:
    return re.sub(r"\d[\d.]*", "#", text.replace("─", "")).split()


@pytest.mark.parametrize("page", ["actuators", "fleet", "gap", "walkers"])
def test_every_block_of_the_pages_runs(repository: Path, tmp_path: Path, page: str) -> None:
    blocks = pages.runnable(repository / f"docs/{page}.md")
    assert blocks
    pages.run(blocks, tmp_path)


@pytest.mark.parametrize("page", ["docs/concepts.md", "docs/report.md"])
def test_says_of_values_what_the_report_does(repository: Path, page: str) -> None:
    text = (repository / page).read_text(encoding="utf-8").replace("`", "")
    assert VALUES in " ".join(text.split())


def test_says_of_every_effect_what_the_catalogue_does(repository: Path) -> None:
    rows = {}
    for line in (repository / "docs/catalogue.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.replace("\\|", "|") for cell in re.split(r"(?<!\\) ?\| ?", line)[1:-1]]
        if len(cells) == 3:
            rows[cells[0].strip("`")] = cells[1:]
    said = {name: rows.get(name) for name in CATALOGUE}
    assert said == {name: [one.equation, one.symptom] for name, one in CATALOGUE.items()}
