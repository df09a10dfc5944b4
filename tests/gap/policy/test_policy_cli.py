"""`walkerkit policy`, and a robot whose drive's law runs in Python."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.gap.policy.balance import make_environment, pendulum, policy, saved
from tests.gap.refused import refused
from walkerkit import gap
from walkerkit.gap.cli import app
from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.load_robot import load_robot

MODULE = """
from tests.gap.policy.balance import make_environment, policy
from walkerkit.actuators import IdealPdActuatorCfg
from walkerkit.walkers import MjcfWalker

def pd():
    cfg = IdealPdActuatorCfg(
        joint_names_expr=("hinge",), stiffness=30.0, damping=0.1, effort_limit=20.0
    )
    return MjcfWalker.from_file("pendulum.xml", cfg)
"""


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: a model, a diagnosis of it, and a module."""
    model = pendulum(tmp_path)
    saved(tmp_path / "result", model, {"sensor_delay": {"delay": 0.06}})
    (tmp_path / "mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


CALL = ("policy", "result", "pendulum.xml", "--environment", "mine:make_environment")


def test_the_command_says_who_breaks_it_and_writes_it_down(found: Path) -> None:
    call = [*CALL, "--policy", "mine:policy", "--episodes", "3"]
    done = CliRunner().invoke(app, call, catch_exceptions=False)
    assert done.exit_code == 0
    assert "What breaks this policy is sensor_delay" in done.stdout
    content = json.loads((found / "result" / "policy" / "policy.json").read_text())
    assert content["blamed"] == ["sensor_delay"]
    again = CliRunner().invoke(app, [*call, "--json"], catch_exceptions=False)
    assert json.loads(again.stdout) == content


def test_what_cannot_be_used_is_refused_before_anything_runs(found: Path) -> None:
    (found / "result" / "policy").mkdir()
    (found / "result" / "policy" / "policy.json").write_text("mine")
    with pytest.raises(InputError, match="is in the way"):
        CliRunner().invoke(app, [*CALL, "--policy", "mine:policy"], catch_exceptions=False)
    with pytest.raises(InputError, match=r"walk\.onnx: no such file"):
        CliRunner().invoke(
            app, [*CALL, "--policy", "walk.onnx", "--out", "new"], catch_exceptions=False
        )
    assert not (found / "new").exists()


def test_laws_in_python_are_those_of_the_model_that_is_given(found: Path) -> None:
    """A folder holds none, so that they come from the walker."""
    robot = load_robot("mine:pd", floating=True)
    folder = saved(found / "of_pd", robot, {"position_gain": {"kp": -29.0}})

    def hold(timestep: object) -> list[float]:
        return [0.0]

    done = gap.policy_gap(make_environment, hold, folder, model="mine:pd", episodes=3)
    assert done.blamed == ("position_gain",)
    assert done.outcomes[0].effects == ()
    assert sum(one.fell for one in done.outcomes[0].episodes) == 0
    refused(
        lambda: gap.policy_gap(make_environment, hold, folder, model="pendulum.xml"),
        "runs in Python",
        "package.module:callable",
    )


def test_a_wrong_encoder_before_a_law_in_python_is_refused(found: Path) -> None:
    folder = saved(found / "of_pd", load_robot("mine:pd"), {"encoder_gain": {"excess": 0.2}})
    refused(
        lambda: gap.policy_gap(make_environment, policy, folder, model="mine:pd"),
        "encoder_gain",
        "runs in Python",
    )
