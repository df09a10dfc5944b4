"""The examples on the public logs of real hardware: what is named, and how far the gap shrinks."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from walkerkit import gap


def _example(repository: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(repository / "examples"))
    spec = importlib.util.spec_from_file_location(name, repository / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)  # where dataclasses look
    spec.loader.exec_module(module)
    return module


# The whole catalogue on whole logs takes minutes; it is what the examples print. Here is enough of
# both to show the same.
Cut = Callable[..., None]


def _joint_rms(result: gap.Result, joint: str) -> float:
    return float(result.diagnosis.gap.joints[joint].after)


@pytest.fixture
def cut(real_logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cut:
    """Lets the examples find no more of a data set than the beginnings of some of its logs."""

    def cut(name: str, seconds: float, *stems: str) -> None:
        folder = tmp_path / "data" / name
        folder.mkdir(parents=True)
        for model in (real_logs / name).glob("*.xml"):
            shutil.copyfile(model, folder / model.name)
        for stem in stems:
            with (real_logs / name / f"{stem}.csv").open(encoding="utf-8") as log:
                header, *rows = log
            kept = [row for row in rows if float(row.partition(",")[0]) < seconds]
            (folder / f"{stem}.csv").write_text("".join([header, *kept]), encoding="utf-8")
        monkeypatch.setenv("WALKERKIT_DATA", str(folder.parent))

    return cut


class TestRealLogs:
    def test_double_pendulum(
        self, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: Cut
    ) -> None:
        example = _example(repository, "double_pendulum", monkeypatch)
        held_out = [Path(name).stem for name in example.HELD_OUT]
        fitted = ("20230629-143339", "20230629-143524", "20230629-143601", "20230629-143906")
        cut("double_pendulum", 3.5, *fitted, *held_out)
        few = ("viscous_friction", "coulomb_friction", "armature")
        result = example.main(tmp_path / "out", few)
        named = {effect.effect: effect for effect in result.diagnosis.effects}
        assert set(named["coulomb_friction"].joints) == {"shoulder", "elbow"}
        assert result.diagnosis.gap.horizon == 0.5
        assert _joint_rms(result, "shoulder") <= 0.035
        assert _joint_rms(result, "elbow") <= 0.060
        # The makers' own fit, as frictionloss.
        for estimate, published in zip(
            named["coulomb_friction"].parameters, (0.251, 0.188), strict=True
        ):
            assert estimate.value == pytest.approx(published, rel=0.2)

    def test_emps(
        self, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: Cut
    ) -> None:
        # To the other end and back.
        cut("emps", 6.2, "identification", "pulses")
        example = _example(repository, "emps", monkeypatch)
        few = ("viscous_friction", "coulomb_friction", "torque_bias")
        result = example.main(tmp_path / "out", few)
        named = {effect.effect: effect for effect in result.diagnosis.effects}
        # A mean of the friction with an offset, as the makers of the data have it, is friction by
        # direction, and says so.
        assert "differs between the directions" in " ".join(str(result).split())
        assert "asymmetric_friction" in named["torque_bias"].indistinguishable_from
        told = example.on_asymmetric_friction(result)
        assert "leaves the same log as coulomb_friction and torque_bias, which are named" in told
        means, biases = (named[n].parameters for n in ("coulomb_friction", "torque_bias"))
        assert f": {means[0].value - biases[0].value:.1f} N forward and " in told
        assert named["torque_bias"].equivalent[0][1] in told
        before, after = example.relative_effort_error(result)
        assert before == pytest.approx(0.68, abs=0.02)
        assert after <= 0.12
        # Janot, Gautier and Brunot (2019).
        assert named["viscous_friction"].parameters[0].value == pytest.approx(203.5, rel=0.1)
        assert named["coulomb_friction"].parameters[0].value == pytest.approx(20.39, rel=0.1)
        assert named["torque_bias"].parameters[0].value == pytest.approx(3.16, rel=0.2)

    def test_xl330(
        self,
        repository: Path,
        real_logs: Path,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        example = _example(repository, "xl330", monkeypatch)
        monkeypatch.setenv("WALKERKIT_DATA", str(real_logs))
        result = example.main(tmp_path, ["viscous_friction", "coulomb_friction"])
        size = result.diagnosis.gap.position
        assert size.before == pytest.approx(0.162, abs=0.002)
        assert size.after < 0.9 * size.before
        models = sorted(path.name for path in tmp_path.glob("model*.xml"))
        assert models == [f"model_kp{gain}.xml" for gain in (100, 200, 400, 800)]
        again = gap.compare(tmp_path / "experiments.toml")
        assert again.gap.position.before == pytest.approx(size.after, rel=1e-3)
        written = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
        assert written["gap"]["after"] == pytest.approx(size.after, rel=1e-5)
        assert np.isfinite(written["gap"]["noise_floor"])
        assert capsys.readouterr().out == ""
        if size.after > 0.125:
            pytest.xfail("one of the two is named, which leaves 0.13 rad; both reach 0.122 rad")


class TestPyBulletPort:
    def test_nothing_is_missing_where_it_does_what_the_urdf_says(
        self, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        example = _example(repository, "pybullet_port", monkeypatch)
        found = example.diagnose(tmp_path, {}, seconds=2.0).diagnosis
        assert found.verdict == "no_gap"
        assert found.effects == found.considered == ()
        # Both simulators step alike; what is left is the state that the replay starts from.
        assert found.gap.position.before < 1e-8

    def test_velocity_motors_are_dry_friction(
        self, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        example = _example(repository, "pybullet_port", monkeypatch)
        found = example.diagnose(
            tmp_path,
            example.FRICTION,
            seconds=2.0,
            effects=["coulomb_friction", "viscous_friction", "torque_bias", "command_delay"],
        ).diagnosis
        (friction,) = found.effects
        assert friction.effect == "coulomb_friction"
        assert friction.joints == tuple(example.FRICTION)
        assert friction.indistinguishable_from == ()
        for estimate in friction.parameters:
            assert estimate.value == pytest.approx(example.FRICTION[estimate.place], rel=0.05)
        assert found.gap.position.after < 0.1 * found.gap.position.before


def test_the_policy_falls_by_the_weak_drive_and_not_by_the_late_targets(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    example = _example(repository, "policy", monkeypatch)
    found = example.main(tmp_path / "out", episodes=3)
    assert found.blamed == ("effort_limit",)
    fell = {one.name: sum(each.fell for each in one.episodes) for one in found.outcomes}
    assert fell["as given"] == fell["with command_delay alone"] == 0
    assert fell["with effort_limit alone"] == fell["mended"] == 3
    assert (tmp_path / "out" / "policy" / "policy.html").is_file()
