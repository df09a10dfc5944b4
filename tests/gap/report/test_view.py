"""The robot that moves: poses as MuJoCo's, meshes that fit, and frames that a browser draws."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.gap.report.browser import browse, needs_browser, picture
from walkerkit.gap import compare
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.standing import RATE, standing_targets, write_standing
from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.html import MOST, unembedded
from walkerkit.gap.report.motion import WHICH, Motion, load_motions, save_motions
from walkerkit.gap.report.page import write_report
from walkerkit.gap.report.replayed_motion import LONGEST
from walkerkit.gap.report.samples import unpack
from walkerkit.gap.report.scene import scene, simplified
from walkerkit.gap.report.shapes import clad, shapes

LegDiagnosis = Callable[..., Diagnosis]
VIEW = Path(__file__).resolve().parents[3] / "gap" / "report" / "assets" / "view.js"
# A free base, a hinge off its body's origin, a slide, a ball; meshes and every primitive.
ROBOT = """
<mujoco model="all">
  <compiler angle="radian"/>
  <asset><mesh name="round" vertex="{vertices}"/></asset>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body name="trunk" pos="0 0 0.5" quat="0.9 0.1 0 0.3">
      <freejoint/>
      <geom type="mesh" mesh="round" pos="0 0.02 0" mass="1"/>
      <body name="hip" pos="0.1 0.05 0" euler="0.3 0.2 0.1">
        <joint name="hip" axis="1 0.5 0" pos="0.02 -0.01 0.03" ref="0.2"/>
        <geom type="box" size="0.02 0.03 0.04"/>
        <geom type="ellipsoid" size="0.03 0.02 0.05" pos="0.05 0 0"/>
        <body name="calf" pos="0 0 -0.2">
          <joint name="calf" type="slide" axis="0 0.6 0.8" ref="0.05"/>
          <geom type="capsule" fromto="0 0 0 0.02 0 -0.1" size="0.02"/>
          <body name="toe" pos="0.02 0 -0.1">
            <joint name="toe" type="ball" pos="0 0 0.01"/>
            <geom type="cylinder" size="0.02 0.05"/>
            <geom type="sphere" size="0.03" pos="0 0 -0.06"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def text(points: int = 300) -> str:
    """The robot, with so many vertices in its mesh, an ellipsoid."""
    height = np.linspace(-1, 1, points)
    turn = np.arange(points) * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - height**2)
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), 2 * height], axis=1)
    return ROBOT.format(vertices=" ".join(f"{0.1 * value:.6f}" for value in vertices.flat))


def motion(points: int = 300, frames: int = 60) -> Motion:
    """All joints at once; the simulated ones somewhere else."""
    model = mujoco.MjModel.from_xml_string(text(points))
    generator = np.random.default_rng(0)
    time = np.arange(frames) / 30
    qpos = model.qpos0 + np.sin(time[:, None] * generator.uniform(0.5, 2, model.nq))
    return Motion(
        recording="walk",
        held_out=True,
        robot=0,
        model=model,
        time=time,
        joints=tuple(map(str, range(model.nq))),
        addresses=tuple(range(model.nq)),
        measured=qpos,
        before=qpos + 0.2,
        after=qpos + 0.02,
    )


def data_of(path: Path, name: str) -> object:
    """What a page carries for its scripts."""
    found = re.search(rf'id="{name}">(.*?)</script>', path.read_text(encoding="utf-8"))
    assert found is not None
    return unembedded(found[1])


@pytest.fixture
def page(leg: LegDiagnosis, tmp_path: Path) -> Path:
    path = tmp_path / "report.html"
    write_report(replace(leg(), motions=(motion(),)), path, title="leg")
    return path


@needs_browser
def test_a_browser_finds_the_poses_that_mujoco_does(page: Path, tmp_path: Path) -> None:
    carried = data_of(page, "scenes")
    assert isinstance(carried, dict)
    (one,) = carried["motions"]
    for which in WHICH:
        one[which] = [unpack(column).tolist() for column in one[which]]
    frames = [0, 7, 31, 59]
    script = (
        f"const [scene, motion] = [{json.dumps(carried['scenes'][0])}, {json.dumps(one)}];"
        f"const found = {json.dumps(WHICH)}.map((which) => {frames}.map((frame) => robotView.poses("
        "scene, robotView.positions(scene, motion, which, frame, 1))));"
        "document.getElementById('found').textContent = JSON.stringify(found);"
    )
    alone = tmp_path / "alone.html"
    alone.write_text(
        f"<p id='found'></p><script>{VIEW.read_text()}</script><script>{script}</script>"
    )
    dom, console = browse(alone)
    assert console == []
    written = re.search(r'<p id="found">(.*?)</p>', dom)
    assert written is not None
    given = motion()
    data = mujoco.MjData(given.model)
    for which, poses in zip(WHICH, json.loads(written[1]), strict=True):
        for frame, bodies in zip(frames, poses, strict=True):
            data.qpos[:] = given.qpos(which)[frame]
            mujoco.mj_kinematics(given.model, data)
            for body, pose in enumerate(bodies):
                np.testing.assert_allclose(pose["pos"], data.xpos[body], atol=1e-3)
                same = abs(np.dot(pose["quat"], data.xquat[body]))
                assert same > 1 - 1e-6


@needs_browser
def test_frames_differ_as_the_time_does(page: Path, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")

    def shown(place: str, size: str = "1200,1000") -> np.ndarray:
        picture(page, tmp_path / "shot.png", place, size=size)
        return np.asarray(image.open(tmp_path / "shot.png").convert("RGB"), dtype=int)

    first, later = shown("#t=0.4"), shown("#t=1.2")
    changed = np.abs(later - first).max(axis=2) > 40
    assert changed.sum() > 1500  # the robot, the slider and the line in the plots
    orange = (first[..., 0] > 180) & (first[..., 2] < first[..., 0] - 60)
    assert orange.sum() > 500
    phone = shown("#t=0.4&errors=5", "390,844")
    assert phone.shape[:2] == (844, 390)
    assert not np.array_equal(phone, shown("#t=1.2&errors=5", "390,844"))


@needs_browser
def test_one_time_is_the_sliders_the_robots_and_the_plots(page: Path) -> None:
    dom, console = browse(page, place="#t=1.21")
    assert console == []
    assert 'id="moving" class="live"' in dom
    assert re.search(r'<output id="now"[^>]*>1\.20 s<', dom)
    assert re.search(r'class="cursor" style="left: \d+', dom)


@needs_browser
def test_without_webgl_poses_are_drawn(page: Path) -> None:
    dom, _ = browse(page, webgl=False)
    assert 'id="moving" class="still"' in dom
    poses = re.findall(r'<svg viewBox="0 0 160 160".*?</svg>', dom, re.DOTALL)
    assert len(poses) == 5
    for pose in poses:
        paths = re.findall(r'<path class="(\w+)" d="(M[^"]+)"', pose)
        assert [name for name, _ in paths] == ["after", "before", "measured"]
    assert len({*poses}) == 5


def test_a_page_has_room_for_a_fine_mesh_and_many_recordings(
    leg: LegDiagnosis, tmp_path: Path
) -> None:
    joints = ("hip", "thigh", "calf")
    some = leg(joints=joints, samples=20_000)
    noise = np.random.default_rng(1)
    traces = tuple(
        replace(
            trace,
            recording=f"{trace.recording}{k}",
            measured=trace.measured + noise.normal(0, 0.01, trace.measured.size),
        )
        for k in range(20)
        for trace in some.traces
    )
    fine = motion(points=20_000, frames=300)
    motions = tuple(replace(fine, recording=f"walk{k}") for k in range(20))
    path = tmp_path / "report.html"
    recordings = tuple(dict.fromkeys(trace.recording for trace in traces))
    wide = replace(some, traces=traces, motions=motions, recordings=recordings)
    write_report(wide, path, title="leg")
    assert MOST - 400_000 < path.stat().st_size <= MOST
    said = path.read_text(encoding="utf-8")
    assert re.search(r"Signals are drawn with about \d+ samples each", said)
    assert "so that this page has no more than 3 MB" in said
    traces_shown = data_of(path, "traces")
    assert isinstance(traces_shown, list)
    assert len(traces_shown) == len(traces)


@needs_browser
def test_a_page_that_has_no_room_says_so(
    leg: LegDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("walkerkit.gap.report.page.MOST", 2_000_000)  # of plotly.js alone
    path = tmp_path / "report.html"
    write_report(replace(leg(), motions=(motion(),)), path, title="leg")
    dom, console = browse(path)
    assert console == []
    assert "0 of 9 signals are drawn and the robot moves in 0 of 1 recordings" in dom
    assert "The motion of walk is not in this page" in dom


def test_a_coarse_mesh_is_where_the_fine_one_is() -> None:
    model = motion(points=5000).model
    vertices = np.array(model.mesh_vert, dtype=float)
    faces = np.array(model.mesh_face, dtype=int)
    fewer, kept = simplified(vertices, faces, 500)
    assert 100 < len(fewer) <= 500
    assert kept.max() < len(fewer)
    assert len(kept) > len(fewer)  # still a surface
    cell = np.ptp(vertices, axis=0).max() / 8
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(fewer, axis=0), end(vertices, axis=0), atol=cell / 2)
    same, _ = simplified(vertices, faces, len(vertices))
    assert same is vertices
    drawn = scene(model, vertices=500)
    assert len(drawn["meshes"]) == 1
    assert len(unpack(drawn["meshes"][0]["vertices"][0])) <= 500


def test_what_has_no_geom_is_seen_as_rods() -> None:
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><body name="upper"><joint axis="0 1 0"/>
        <inertial pos="0 0 -0.2" mass="1" diaginertia="1 1 1"/>
        <body name="lower" pos="0 0 -0.4"><joint axis="0 1 0"/>
        <inertial pos="0.1 0 -0.2" mass="1" diaginertia="1 1 1"/>
        </body></body></worldbody></mujoco>"""
    )
    model = spec.compile()
    upper, lower = shapes(model)
    np.testing.assert_allclose(upper.pos, [0, 0, -0.2])
    np.testing.assert_allclose(lower.pos, [0.1, 0, -0.2])
    dressed = clad(spec, model)
    assert dressed.ngeom == 2
    np.testing.assert_allclose(dressed.geom_pos, [upper.pos, lower.pos], atol=1e-6)
    np.testing.assert_allclose(dressed.body_mass, model.body_mass)
    assert clad(spec, dressed) is dressed


def test_a_robot_on_its_feet_moves_as_it_was_measured(tmp_path: Path) -> None:
    model = write_standing(tmp_path)
    targets = standing_targets(np.random.default_rng(4), seconds=1.2)
    logs = run_hardware(
        model, [targets["sway"], targets["steps"]], rate=RATE, seed=5, names=["sway", "steps"]
    )
    found = compare(model, logs).motions
    held_out = [one.held_out for one in found]
    assert held_out == sorted(held_out, reverse=True)
    assert {one.recording.partition("[")[0] for one in found} == {"sway", "steps"}
    for one in found:
        log = next(r for r in logs if one.recording.startswith(r.name))
        qpos = one.qpos("measured")
        place = [np.interp(one.time, log.time, log.columns[f"base/position_{a}"]) for a in "xyz"]
        np.testing.assert_allclose(qpos[:, :3], np.stack(place, axis=1), atol=1e-9)
        real = np.interp(one.time, log.time, log.columns["base/quaternion_w"])
        np.testing.assert_allclose(np.abs(qpos[:, 3]), np.abs(real), atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1, atol=1e-9)
        assert np.diff(one.time).min() > 1 / 31
        assert one.time[-1] - one.time[0] <= LONGEST
        assert not one.absent
        simulated = one.qpos("before")
        assert 0 < np.abs(simulated - qpos).max() < 0.5


def test_the_worst_ten_seconds_of_a_long_recording_are_kept(leg: LegDiagnosis) -> None:
    from walkerkit.gap.report.replayed_motion import _worst

    time = np.arange(0, 60, 0.01)
    error = np.where((time > 33) & (time < 38), 0.2, 0.01)[:, None]
    span = _worst(time, error)
    assert time[span][0] <= 33.1
    assert time[span][-1] >= 37.9
    assert 9.9 < np.ptp(time[span]) <= LONGEST + 1e-6
    assert np.ptp(time[_worst(time, np.where(time > 59, 1.0, 0.0)[:, None])]) > 9.9
    assert _worst(time[:500], error[:500]) == slice(0, 500)


def test_motions_are_read_again(tmp_path: Path) -> None:
    one = motion()
    names = ["hip", "calf"]
    addresses = [int(one.model.joint(name).qposadr[0]) for name in names]
    some = {which: getattr(one, which)[:, addresses] for which in WHICH}
    kept = replace(one, joints=tuple(names), addresses=tuple(addresses), **some)
    (tmp_path / "model.xml").write_text(text())
    save_motions([kept], ["model.xml"], tmp_path / "motions.npz")
    (again,) = load_motions(tmp_path)
    assert again.addresses == kept.addresses
    for which in WHICH:
        np.testing.assert_allclose(again.qpos(which), kept.qpos(which), atol=1e-6)
    large = again.qpos("before", factor=5) - again.qpos("measured")
    np.testing.assert_allclose(large[:, addresses], 1.0, atol=1e-5)
