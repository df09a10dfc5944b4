"""Actuators, laws and effects of a user's own, written in files outside of the package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from walkerkit.actuators import DrivetrainLaw
from walkerkit.actuators.drivetrain import LAWS, StribeckFriction, UnknownLawError, law_named
from walkerkit.gap.effects import CATALOGUE, JointEffect
from walkerkit.gap.errors import InputError
from walkerkit.gap.workflow import effect_names, effects_to_send

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="link" pos="0 0 1">
      <joint name="knee" axis="0 1 0" armature="0.02" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.8"/>
    </body>
  </worldbody>
</mujoco>
"""
STUDY = """
import json
from dataclasses import replace

from dm_control import composer

import compensated
from walkerkit import gap
from walkerkit.actuators import BuiltinPdActuatorCfg
from walkerkit.tasks import TrackJoints
from walkerkit.walkers import MjcfWalker


def walker(cfg=None, **more):
    return MjcfWalker.from_file("pendulum.xml", cfg or compensated.DRIVES, **more)


def native(**more):
    return walker(
        BuiltinPdActuatorCfg(joint_names_expr=(".*",), stiffness=40.0, damping=1.0), **more
    )


def logs(make):
    return [
        gap.record(
            composer.Environment(TrackJoints(make(), excitation=kind), random_state=0),
            seconds=1.0,
            name=kind,
        )
        for kind in ("chirp", "steps", "slow_triangle")
    ]

"""
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def study(folder: Path, repository: Path, script: str) -> list[Any]:
    """What a script of a user's prints, beside the modules of the documentation."""
    page = (repository / "docs/own_actuator.md").read_text(encoding="utf-8")
    for code in BLOCK.findall(page):
        named = re.match(r"# (\w+\.py)\n", code)
        if named:
            (folder / named[1]).write_text(code, encoding="utf-8")
    (folder / "pendulum.xml").write_text(PENDULUM, encoding="utf-8")
    (folder / "study.py").write_text(STUDY, encoding="utf-8")
    (folder / "script.py").write_text(textwrap.dedent(script), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "script.py"],
        cwd=folder,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_what_users_write_in_files_of_their_own_works(tmp_path: Path, repository: Path) -> None:
    readme = (repository / "README.md").read_text(encoding="utf-8")
    section = readme.partition("### Adding one")[2]
    (tmp_path / "mine.py").write_text(BLOCK.findall(section)[0], encoding="utf-8")
    catalogue, beside, by_law, saved, by_readme = study(
        tmp_path,
        repository,
        """
        import heat
        import mine
        from study import *
        from walkerkit.gap.effects import CATALOGUE

        print(json.dumps([*CATALOGUE][-2:]))

        # Beside an own actuator, with own effects among those that are tried.
        def rough():
            return walker(replace(compensated.DRIVES, frictionloss=0.3))

        result = gap.diagnose(
            "study:walker",
            logs(rough),
            effects=["coulomb_friction", mine.ViscousFriction(), heat.WeakAtSpeedEffect],
        )
        effects = result.diagnosis.effects
        print(json.dumps([result.diagnosis.verdict, *(e.effect for e in effects)]))

        # An own drivetrain law, around MuJoCo's own drive.
        def weak():
            return native(laws=(heat.WeakAtSpeed(joint_names_expr=(".*",), loss=0.2),))

        fitted = gap.fit(gap.load("study:native", logs(weak)), {"weak_at_speed": ["knee"]})
        print(json.dumps(fitted.effects[0].parameters[0].value))
        (robot,) = fitted.robots
        print(json.dumps(robot.laws))

        # The effect of the README.
        def damped():
            robot = native()
            robot.mjcf_model.find("joint", "knee").damping = 0.4
            return robot

        fitted = gap.fit(gap.load("study:native", logs(damped)), "my_viscous_friction")
        print(json.dumps(fitted.effects[0].parameters[0].value))
        """,
    )
    assert catalogue == ["weak_at_speed", "my_viscous_friction"]
    assert beside == ["explained", "coulomb_friction"]
    assert by_law == pytest.approx(0.2, rel=0.05)
    assert saved == {"knee": {"weak_at_speed": {"loss": by_law}}}
    assert by_readme == pytest.approx(0.3, rel=0.05)


class TestTheVocabularyIsOpen:
    def test_effects_are_known_by_name_and_as_objects(self) -> None:
        class Mine(JointEffect):
            name = "mine"
            equation = symptom = added_as = source = "told"

            def acts_on(self, robot, joint):
                return True

            def parameters(self, robot, site):
                return ()

            def apply(self, trials, site, values):
                return

        assert [*CATALOGUE][-1] == "mine"
        assert effect_names(["mine", "armature"]) == ("mine", "armature")
        assert effect_names(Mine) == effect_names(Mine()) == ("mine",)
        given = Mine()
        assert effect_names([given, "armature"]) == ("mine", "armature")
        assert CATALOGUE["mine"] is given
        assert effects_to_send(["armature", "mine"]) == ("armature", given)
        assert given in effects_to_send(None)
        with pytest.raises(InputError, match="neither the name of an effect nor an effect"):
            effect_names([Mine, 3])

    def test_without_effects_of_a_users_own_all_stays_all(self) -> None:
        assert effects_to_send(None) is None
        assert "mine" not in CATALOGUE

    def test_an_effect_that_says_too_little_is_refused(self) -> None:
        class Mute(JointEffect):
            name = "mute"
            equation = symptom = "told"

            def acts_on(self, robot, joint):
                return True

            def parameters(self, robot, site):
                return ()

            def apply(self, trials, site, values):
                return

        with pytest.raises(InputError, match="Mute lacks added_as, source"):
            effect_names(Mute)

    def test_names_that_are_taken_are_refused(self) -> None:
        with pytest.raises(ValueError, match="walkerkit has an effect of that name"):
            type("Mine", (JointEffect,), {"name": "armature"})
        with pytest.raises(ValueError, match="walkerkit has a law of that name"):
            type("Mine", (DrivetrainLaw,), {"name": "cogging"})
        with pytest.raises(ValueError, match="give it a `name` of its own"):
            type("Mine", (StribeckFriction,), {})

    def test_laws_are_known_once_defined(self) -> None:
        assert law_named("cogging") is LAWS["cogging"]
        with pytest.raises(UnknownLawError, match=r"no drivetrain law 'my_drag'.*Import"):
            law_named("my_drag")

        class MyDrag(DrivetrainLaw):
            name = "my_drag"
            stage = "joint"
            neutral: dict = {"gain": 0.0}  # noqa: RUF012

            @staticmethod
            def apply(step, p, state):
                step.extra -= np.zeros(1)

        assert law_named("my_drag") is MyDrag
        with pytest.raises(TypeError, match="neutral values for"):
            MyDrag(joint_names_expr=(".*",))
