"""The report: one file, nothing fetched, names are text, and a real browser draws it."""

from __future__ import annotations

import html
import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gap.report.browser import browse, needs_browser
from walkerkit.gap import Recording, compare
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.report.diagnosis import Diagnosis, Hint, Verdict
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.html import unembedded
from walkerkit.gap.report.page import write_report

LegDiagnosis = Callable[..., Diagnosis]
HOSTILE = (
    "<img src=x onerror=\"document.title='pwned'\">",
    "hip' \" %{x} $\\alpha$ &amp; <!-- [red]",
    "</script><script>document.title='pwned'</script>",
)


@dataclass
class Page(HTMLParser):
    """Tags with their attributes, the text that a reader sees, and the scripts."""

    source: str
    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    scripts: list[str] = field(default_factory=list)
    styles: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self._open = ""
        self.feed(self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._open = tag
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        self._open = ""

    def handle_data(self, data: str) -> None:
        {"script": self.scripts, "style": self.styles}.get(self._open, self.words).append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())

    def data(self, name: str) -> Any:
        """What the page carries for its scripts."""
        ids = [attributes.get("id") for attributes in self.attributes("script")]
        return unembedded(self.scripts[ids.index(name)])

    def attributes(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def read(diagnosis: Diagnosis, folder: Path, title: str = "leg.xml") -> Page:
    path = folder / "report.html"
    write_report(diagnosis, path, title=title, catalogue=CATALOGUE)
    return Page(path.read_text(encoding="utf-8"))


def test_sections_from_the_verdict_to_the_use(leg: LegDiagnosis, tmp_path: Path) -> None:
    page = read(leg(), tmp_path)
    order = (
        *("Explained", "The gap is explained by coulomb_friction at calf (98 % sure)"),
        *("from 6.6 to 1.1 mrad", "Where the gap is", "What remains", "Where it stands out"),
        *("How the gap shrank", "Simulated against measured", "What was added to the model"),
        *("0.152 ± 0.004 N·m", "0.144 to 0.160 N·m", "0 to 3.2 N·m"),
        *(
            "What was considered",
            "What cannot be told apart",
            "Notes: what",
            "How to use the model",
        ),
        *("walkerkit compare model.xml RECORDING...", "MjcfWalker", "chirp, steps"),
    )
    sections = page.text.index("How to use the model") + 1  # after the last link to one
    places = [
        page.text.find(part, page.text.index("leg.xml") + 7 if k < 3 else sections)
        for k, part in enumerate(order)
    ]
    assert places == sorted(places), dict(zip(order, places, strict=True))
    assert -1 not in places
    assert CATALOGUE["coulomb_friction"].equation in page.text
    for says in (
        "except limits, rest angles, timesteps",
        "the weight of all structures that have the effect",
    ):
        assert says in page.text
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in (
        page.attributes("meta")
    )
    assert "@media print" in page.styles[0]


def test_every_link_leads_to_a_section(confused: Diagnosis, tmp_path: Path) -> None:
    page = read(confused, tmp_path)
    places = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    links = [str(attributes["href"]) for attributes in page.attributes("a")]
    assert len(links) >= 9
    assert {link.removeprefix("#") for link in links} <= places
    headings = re.findall(r"<h[23][^>]*>(.*?)</h[23]>", page.source)
    names = re.findall(r'<a href="#\w+">(.*?)(?: \(\d+\))?</a>', page.source)
    assert len(names) == len(links)
    assert {*names} <= {*headings}


def test_the_map_is_a_table_that_needs_no_pointer(leg: LegDiagnosis, tmp_path: Path) -> None:
    page = read(leg(), tmp_path)
    heats = [t for t in page.attributes("table") if "heat" in str(t.get("class"))]
    assert len(heats) == 4  # position and effort, before and after
    cells = [c for c in page.attributes("td") if str(c.get("title")).startswith("calf (velocity")]
    assert cells[0]["title"] == (
        "calf (velocity reversal): 19 mrad, 50 % of the squared gap, lift 8.3"
    )
    assert cells[0]["class"] == "l5"
    assert cells[1]["class"] in ("l0", "l1")  # what remains, in the same shades


@pytest.mark.parametrize("signal", ["position", "effort"])
def test_places_are_said_to_be_of_the_signal_that_they_are_of(
    leg: LegDiagnosis, tmp_path: Path, signal: str
) -> None:
    diagnosis = leg()
    found = tuple(replace(at, signal=signal) for at in diagnosis.locations)
    page = read(replace(diagnosis, locations=found), tmp_path)
    assert f"of the squared {signal} gap" in page.text


def test_held_out_recordings_come_first_and_the_worst_joint_is_shown(
    leg: LegDiagnosis, tmp_path: Path
) -> None:
    page = read(leg(), tmp_path)
    assert [group["label"] for group in page.attributes("optgroup")] == ["held out", "fitted"]
    chosen = ["selected" in option for option in page.attributes("option")]
    assert chosen == [True, False, False, False, False, True, True]  # walk…; …, calf; position
    traces = page.data("traces")
    assert len(traces) == 9
    assert (traces[2]["joint"], traces[2]["errorUnit"]) == ("calf", "mrad")


def test_candidates_are_ranked_and_say_by_how_much_they_lost(
    leg: LegDiagnosis, confused: Diagnosis, tmp_path: Path
) -> None:
    text = read(leg(), tmp_path).text
    assert "coulomb_friction83 %named backlash79 %lost" in text
    assert "Also tried: series_elasticity (7 %), " in text
    assert "loop_delay (diverged)." in text
    text = read(confused, tmp_path).text
    assert "One other effect beside them" in text
    assert "sensor_delay24 %cannot be told apart" in text
    lost = tuple(replace(one, verdict="lost") for one in leg().considered)
    text = read(replace(leg(), considered=lost), tmp_path).text
    assert "Ordinary effects, each against a fit without it: none is named" in text


def test_bounds_doubts_and_the_next_experiment(confused: Diagnosis, tmp_path: Path) -> None:
    text = read(confused, tmp_path).text
    assert "mass shin0.500 kg⚠ at its bound" in text
    assert "0.500 ±" not in text
    assert "cannot be told from sensor_delay or setpoint_filter" in text
    assert "Send next_experiment.csv to the robot" in text
    assert "body mass + Δm" in text  # payload's equation
    assert "RECORDED.csv" not in text  # no model of its own


def test_an_experiment_with_a_model_of_its_own_comes_with_its_manifest(
    confused: Diagnosis, tmp_path: Path
) -> None:
    wanted = confused.next_experiment
    assert wanted is not None
    payload = replace(
        wanted,
        set_up="known_payload",
        instruction="Put 0.5 kg on body shin.",
        model="next_experiment.xml",
    )
    again = '[[experiment]]\nmodel = "<a> & b.xml"\n'
    write_report(
        replace(confused, next_experiment=payload),
        tmp_path / "r.html",
        title="leg",
        experiments=again,
    )
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    found = re.search(r"<code>(\[\[experiment.*?)</code>", page, re.DOTALL)
    assert found is not None
    assert tomllib.loads(html.unescape(found[1])) == tomllib.loads(again)


def test_models_are_used_where_they_are(leg: LegDiagnosis, tmp_path: Path) -> None:
    def use(*models: str) -> str:
        write_report(leg(), tmp_path / "r.html", title="leg", models=models)
        page = Page((tmp_path / "r.html").read_text(encoding="utf-8"))
        return page.text.partition("How to use the model")[2]

    assert "model_a.xml , model_b.xml" in use("model_a.xml", "model_b.xml").replace(",", " ,")
    assert "walkerkit compare experiments.toml" in use("model_a.xml", "model_b.xml")
    assert "walkerkit apply . MODEL.xml" in use("model.xml")
    assert "walkerkit export . --to mjlab" in use("model.xml")
    alone = use()
    assert 'result.save("diagnosis")' in alone
    assert ".xml" not in alone


def test_stopgaps_are_told_from_explanations(leg: LegDiagnosis, tmp_path: Path) -> None:
    assert "Stopgaps" not in read(leg(), tmp_path).text
    hint = Hint(
        kind="learned",
        joint="<calf>",
        title="a formula at <calf>",
        statement="τ = −0.3 q̇ |q̇|",
        signal="position",
        size=GapSize(unit="rad", before=0.0066, after=0.002, noise_floor=0.001),
        use="print(1)",
    )
    text = read(replace(leg(), hints=(hint,)), tmp_path).text
    assert (
        "a formula at <calf> τ = −0.3 q̇ |q̇| With it, the position error of <calf> would be" in text
    )
    assert "explains nothing" in text


@pytest.mark.parametrize("verdict", ["no_gap", "unexplained"])
def test_reads_well_with_nothing_found(leg: LegDiagnosis, tmp_path: Path, verdict: Verdict) -> None:
    empty = replace(leg(), verdict=verdict, effects=(), locations=(), remaining=(), traces=())
    page = read(replace(empty, considered=(), notes=(), recordings=(), maps=()), tmp_path)
    assert "The gap and its floors" in page.text
    assert "No signals were kept for this report." in page.text
    assert "model.xml" not in page.text
    assert "after" not in page.text
    assert set(json.loads(page.scripts[0])) == {"steps"}
    assert not page.attributes("select")


def test_names_come_out_as_text(leg: LegDiagnosis, tmp_path: Path) -> None:
    diagnosis = leg(joints=HOSTILE, samples=100)
    notes = (f"about {HOSTILE[2]}",)
    page = read(
        replace(diagnosis, notes=notes, recordings=HOSTILE), tmp_path, title=f"{HOSTILE[0]}.xml"
    )
    assert len(page.scripts) == 3 + 3  # two of data, plotly.js; ours
    assert not page.attributes("img")
    assert all(f"position, {name}" in page.text for name in HOSTILE)
    assert f"about {HOSTILE[2]}" in page.text
    assert page.data("traces")[2]["joint"] == HOSTILE[2]
    for data in page.scripts[:3]:
        assert "<" not in data


def test_nothing_is_fetched(leg: LegDiagnosis, tmp_path: Path) -> None:
    page = read(leg(), tmp_path)
    loading = {"link", "img", "iframe", "object", "embed", "video", "audio", "source", "base"}
    assert not loading & {tag for tag, _ in page.tags}
    assert not [attributes for _, attributes in page.tags if "src" in attributes]
    links = [attributes["href"] for _, attributes in page.tags if "href" in attributes]
    assert all(str(link).startswith("#") for link in links)
    assert not re.search(r"@import|url\(", page.styles[0])
    assert not re.search(r"fetch|XMLHttpRequest|import\(|https?:", "".join(page.scripts[3:]))
    (policy,) = (m["content"] for m in page.attributes("meta") if "http-equiv" in m)
    assert policy is not None
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "http" not in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]


def test_same_diagnosis_same_bytes_but_for_the_seconds(leg: LegDiagnosis, tmp_path: Path) -> None:
    def written(seconds: float) -> bytes:
        path = tmp_path / "report.html"
        write_report(leg(seconds=seconds), path, title="leg.xml")
        return path.read_bytes()

    first, again, slower = written(12.3), written(12.3), written(99.9)
    assert first == again
    assert first != slower
    assert first == slower.replace(b"Diagnosed in 99.9 s.", b"Diagnosed in 12.3 s.")


def test_the_lines_that_load_the_model_run(
    leg: LegDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_report(leg(), tmp_path / "report.html", title="leg.xml")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    (tmp_path / "model.xml").write_text(
        "<mujoco><worldbody><body><joint name='calf'/><geom size='.1'/></body></worldbody>"
        "<actuator><position joint='calf' kp='3'/></actuator></mujoco>"
    )
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in ("load", "walker"):
        found = re.search(rf'<code id="{block}">(.*?)</code>', page, re.DOTALL)
        assert found is not None
        exec(html.unescape(found[1]), names)
    assert names["model"].joint("calf").id == 0
    assert [joint.name for joint in names["walker"].observable_joints] == ["calf"]


@needs_browser
def test_a_browser_draws_the_plots_and_runs_no_name(leg: LegDiagnosis, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(leg(joints=HOSTILE), path, title=HOSTILE[2])
    dom, console = browse(path)
    assert console == []
    assert "<title>Explained: &lt;/script&gt;" in dom
    assert dom.count('<svg class="main-svg"') == 3 * 2  # plotly draws each plot in three layers
    assert dom.count('class="trace scatter') == 2 + 6  # two floors; four signals, two errors
    assert dom.count('class="trace bars') == 2  # what is left, what was taken away
    assert len(re.findall(r'data-title="Zoom(?: in| out)?"', dom)) == 3
    assert 'data-title="Share' not in dom  # plotly's button that uploads the data
    assert "walk (held out): &lt;/script&gt;" in dom.partition('id="shown"')[2][:200]


@needs_browser
def test_a_browser_runs_no_name_of_a_model_a_log_or_an_error_of_wiring(tmp_path: Path) -> None:
    joint = HOSTILE[2]
    model = tmp_path / "<b>arm.xml"
    model.write_text(
        f"""<mujoco><option timestep='0.005' integrator='implicitfast'/><worldbody><body>
        <joint name="{html.escape(joint)}" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></worldbody>
        <actuator><position joint="{html.escape(joint)}" kp="20" kv="0.6"/></actuator></mujoco>"""
    )
    time = np.arange(300) * 0.01
    swing = 0.4 * np.sin(3 * time)
    log = Recording(
        name=HOSTILE[0],
        time=time,
        columns={f"{joint}/position": -swing, f"{joint}/position_target": swing},
        notes=(HOSTILE[0],),
        unused=(HOSTILE[2],),
    )
    diagnosis = compare(model, [log], n_threads=1)
    assert diagnosis.wiring[0].joints == (joint,)
    path = tmp_path / "report.html"
    write_report(diagnosis, path, title=model.name, models=[model.name])
    dom, console = browse(path)
    assert console == []
    assert re.search("<title>[^<]*&lt;b&gt;arm", dom)
    page = Page(dom)
    assert not [attributes for _, attributes in page.tags if "onerror" in attributes]
    assert len(page.scripts) == 4 + 3 + 1  # data, ours, and plotly.js unpacked
    assert f"The sign of {joint} is flipped" in page.text


@needs_browser
def test_a_phone_scrolls_the_page_only_downwards_and_can_choose(
    leg: LegDiagnosis, tmp_path: Path
) -> None:
    joints = [f"{name}_{'of_the_left_rear_leg_' * 4}" for name in ("hip", "thigh", "calf")]
    diagnosis = leg(joints=joints, samples=50)
    diagnosis = replace(diagnosis, traces=(*diagnosis.traces[:2], diagnosis.traces[5]))
    write_report(diagnosis, tmp_path / "report.html", title=f"{'a_long_folder/' * 9}leg.xml")
    path = tmp_path / "phone.html"
    path.write_text(
        """<iframe id="phone" src="report.html" style="width: 360px; height: 800px"></iframe>
        <pre id="seen"></pre>
        <script>const look = () => {
          const page = document.getElementById("phone").contentDocument;
          if (page?.documentElement?.dataset.ready === undefined) return setTimeout(look, 100);
          const select = page.getElementById("joint"), shown = [];
          for (const index of [0, 1, 2]) {
            select.selectedIndex = index;
            select.dispatchEvent(new Event("change"));
            shown.push(page.getElementById("shown").textContent);
          }
          const {scrollWidth, clientWidth} = page.documentElement;
          document.getElementById("seen").textContent =
            JSON.stringify({scrollWidth, clientWidth, shown});
        };
        look();</script>"""
    )
    dom, console = browse(path, "--allow-file-access-from-files")
    assert console == []
    found = re.search(r'<pre id="seen">(.*?)</pre>', dom)
    assert found is not None
    seen = json.loads(found[1])
    assert seen["scrollWidth"] == seen["clientWidth"] <= 360
    assert seen["shown"] == [
        *(f"steps: {joint}, position was not recorded" for joint in joints[:2]),
        f"steps (fitted): {joints[2]}, position",
    ]


@needs_browser
def test_the_policy_stops_a_script_and_a_request_that_are_not_ours(
    leg: LegDiagnosis, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    write_report(leg(samples=50), path, title="leg.xml")
    page = path.read_text(encoding="utf-8")
    smuggled = '<script>document.title = "pwned"</script><img src="other.png">'
    path.write_text(page.replace("<footer>", f"{smuggled}<footer>"), encoding="utf-8")
    dom, console = browse(path)
    assert "<title>pwned" not in dom
    assert len([line for line in console if "Content Security Policy" in line]) == 2, console
