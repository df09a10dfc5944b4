"""Which effect breaks a policy: the one that was put there, and no other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_control import composer, mujoco
from dm_control.rl import control
from dm_env import specs

from tests.gap.policy.balance import (
    PENDULUM,
    Balance,
    make_environment,
    pendulum,
    policy,
    saved,
)
from tests.gap.refused import refused
from walkerkit import gap
from walkerkit.gap.simulation.load_robot import load_robot

LATE = {"sensor_delay": {"delay": 0.06}}
ROUGH = {"viscous_friction": {"damping": 0.05}}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return pendulum(tmp_path / "robot")


def asked(tmp_path: Path, model: Path, named: Any, **options: Any) -> gap.PolicyGap:
    more = {k: options.pop(k) for k in ("rivals", "next_experiment", "fewer") if k in options}
    folder = saved(tmp_path / "result", model, named, **more)
    return gap.policy_gap(
        options.pop("make", make_environment),
        options.pop("policy", policy),
        folder,
        model=model,
        **{"episodes": 4, **options},
    )


class TestBlame:
    @pytest.mark.parametrize(
        ("effect", "values"),
        [
            ("sensor_delay", {"delay": 0.06}),
            ("command_delay", {"delay": 0.06}),
            ("actuator_lag", {"time_constant": 0.3}),
            ("effort_limit", {"limit": 0.02}),
        ],
    )
    def test_what_breaks_it_is_blamed_and_what_does_not_is_not(
        self, tmp_path: Path, model: Path, effect: str, values: Any
    ) -> None:
        found = asked(tmp_path, model, {**ROUGH, effect: values})
        assert found.blamed == (effect,)
        assert found.judgement.verdict == "breaks"
        parts = {part.effect: part for part in found.judgement.parts}
        assert parts["viscous_friction"].verdict == "harmless"
        assert [one.name for one in found.outcomes] == [
            "as given",
            "with viscous_friction alone",
            f"with {effect} alone",
            "mended",
        ]
        assert [sum(e.fell for e in one.episodes) for one in found.outcomes] == [0, 0, 4, 4]
        assert f"What breaks this policy is {effect}" in str(found)

    def test_nothing_is_blamed_where_nothing_breaks_it(self, tmp_path: Path, model: Path) -> None:
        found = asked(tmp_path, model, ROUGH)
        assert found.blamed == ()
        assert found.judgement.verdict == "harmless"
        assert "No effect breaks this policy" in str(found)
        assert "No experiment would change the answer" in str(found)

    def test_two_that_break_it_together_share_the_blame(self, tmp_path: Path, model: Path) -> None:
        half = {"sensor_delay": {"delay": 0.02}, "command_delay": {"delay": 0.02}}
        found = asked(tmp_path, model, half)
        falls = {one.name: sum(e.fell for e in one.episodes) for one in found.outcomes}
        assert falls["mended"] == 4
        assert falls["with sensor_delay alone"] == falls["with command_delay alone"] == 0
        assert set(found.blamed) == {"sensor_delay", "command_delay"}

    def test_of_three_each_is_taken_out_as_well(self, tmp_path: Path, model: Path) -> None:
        three = {**ROUGH, "armature": {"armature": 0.001}, **LATE}
        found = asked(tmp_path, model, three, episodes=3)
        assert found.blamed == ("sensor_delay",)
        falls = {one.name: sum(e.fell for e in one.episodes) for one in found.outcomes}
        assert falls["mended, without sensor_delay"] == 0
        assert falls["mended, without armature"] == 3
        some = asked(tmp_path / "some", model, three, episodes=3, effects=["armature"])
        assert some.blamed == ()
        assert len(some.outcomes) == 2

    @pytest.mark.parametrize("measure", ["falls", "tracking"])
    def test_it_can_be_judged_by_something_else(
        self, tmp_path: Path, model: Path, measure: Any
    ) -> None:
        def make(robot: Any) -> composer.Environment:
            environment = make_environment(robot)
            environment.task.tracking_error = lambda physics: physics.data.qpos[:1]
            environment.task.tracking_unit = "rad"
            return environment

        found = asked(tmp_path, model, {**ROUGH, **LATE}, measure=measure, make=make)
        assert found.blamed == ("sensor_delay",)
        assert found.tracking == ("the task's own error", "rad")

    def test_without_a_clear_loss_it_says_so(self, tmp_path: Path, model: Path) -> None:
        """Some seeds fall, and some do not."""
        rng = np.random.RandomState(5)
        push = {"now": 0.0}

        def sometimes(timestep: Any) -> Any:
            if timestep.first():
                push["now"] = float(rng.choice([0.0, 1.0]))
            late = any(np.ravel(v).size for v in timestep.observation.values())
            assert late
            return np.ones(1) if push["now"] else policy(timestep)

        found = asked(tmp_path, model, ROUGH, policy=sometimes, episodes=8)
        assert found.judgement.verdict == "undecided"
        assert "cannot be told" in str(found)
        assert "More episodes" in str(found)


NEXT = {
    "excitation": "chirp",
    "between": ["viscous_friction", "sensor_delay"],
    "separation": 9.0,
    "file": "next_experiment.csv",
}


class TestRivals:
    def test_the_answer_may_hang_on_which_it_is(self, tmp_path: Path, model: Path) -> None:
        found = asked(
            tmp_path,
            model,
            ROUGH,
            rivals=[("sensor_delay", LATE["sensor_delay"])],
            next_experiment=NEXT,
            fewer={"viscous_friction": ["sensor_delay", "quadratic_drag"]},
        )
        (rival,) = found.judgement.rivals
        assert (rival.effect, rival.in_place_of) == ("sensor_delay", "viscous_friction")
        assert rival.verdict == "breaks"
        assert found.judgement.verdict == "harmless"
        assert found.next_experiment == NEXT
        text = " ".join(str(found).split())
        assert "with sensor_delay for viscous_friction it breaks too" not in text
        assert "with sensor_delay for viscous_friction it breaks" in text
        assert "chirp, next_experiment.csv" in text
        assert "may as well be quadratic_drag" in text

    def test_or_on_nothing(self, tmp_path: Path, model: Path) -> None:
        found = asked(
            tmp_path,
            model,
            LATE,
            rivals=[("command_delay", {"delay": 0.06})],
            next_experiment=NEXT,
        )
        assert found.next_experiment is None
        assert "the same with each member" in str(found)


class Swing(control.Task):  # type: ignore[misc]
    """The pendulum as a task of the suite has it."""

    def __init__(self) -> None:
        self.random = np.random.RandomState(0)

    def initialize_episode(self, physics: Any) -> None:
        physics.data.qpos[:] = self.random.uniform(-0.1, 0.1, 1)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(action)

    def after_step(self, physics: Any) -> None:
        pass

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -20.0, 20.0)

    def get_observation(self, physics: Any) -> Any:
        return {"state": np.concatenate([physics.data.qpos, physics.data.qvel])}

    def get_reward(self, physics: Any) -> float:
        return float(abs(physics.data.qpos[0]) < 0.3)


def compiled(robot: Any) -> Any:
    """An environment of the compiled model, as one that is not composer's."""
    physics = mujoco.Physics.from_model(mujoco.wrapper.MjModel(robot.model))
    return control.Environment(physics, Swing(), time_limit=1.0)


class TestInPlace:
    """Whatever was found is in the environment, or is refused."""

    def test_what_is_of_the_log_alone_is_not_rolled_out(self, tmp_path: Path, model: Path) -> None:
        found = asked(tmp_path, model, {"clock_skew": {"skew": 0.001}, **LATE})
        assert [one.kind for one in found.outcomes] == ["given", "mended"]
        assert "clock_skew changes nothing that a policy meets" in str(found)

    def test_alone_it_is_refused(self, tmp_path: Path, model: Path) -> None:
        skew = {"clock_skew": {"skew": 0.001}}
        refused(lambda: asked(tmp_path, model, skew), "of clock_skew nothing reaches a policy")

    def test_an_environment_without_the_robot_is_refused(self, tmp_path: Path, model: Path) -> None:
        def make(robot: Any) -> composer.Environment:
            from walkerkit.walkers import MjcfWalker

            return composer.Environment(Balance(MjcfWalker.from_file(model)), time_limit=1.0)

        refused(lambda: asked(tmp_path, model, LATE, make=make), "robot.walker()")

    def test_a_task_that_undoes_an_effect_is_refused(self, tmp_path: Path, model: Path) -> None:
        def make(robot: Any) -> composer.Environment:
            task = Balance(robot.walker(), physics_timestep=0.002)
            return composer.Environment(task, time_limit=1.0)

        step = {"timestep": {"timestep": 0.001, "integrator": 0.0}}
        refused(
            lambda: asked(tmp_path, model, step, make=make),
            "timestep: the environment has its own 'opt.timestep'",
        )

    @pytest.mark.parametrize(
        ("effect", "values", "says"),
        [
            ("sensor_delay", {"delay": 0.06}, "reading of hinge"),
            ("actuator_lag", {"time_constant": 0.1}, "law actuator_lag of hinge"),
        ],
    )
    def test_a_compiled_model_is_refused_what_it_cannot_say(
        self, tmp_path: Path, model: Path, effect: str, values: Any, says: str
    ) -> None:
        named = {effect: values}
        refused(lambda: asked(tmp_path, model, named, make=compiled), effect, says)

    def test_a_compiled_model_may_do(self, tmp_path: Path, model: Path) -> None:
        found = asked(
            tmp_path,
            model,
            {**ROUGH, "command_delay": {"delay": 0.06}},
            make=compiled,
            policy=lambda timestep: 20.0 * policy(timestep),
        )
        assert found.blamed == ("command_delay",)

    def test_play_does_not_change_what_is_observed(self, tmp_path: Path) -> None:
        text = PENDULUM.replace("<motor", "<position").replace(
            'ctrlrange="-20 20"', 'ctrlrange="-1 1" kp="40" kv="2"'
        )
        model = pendulum(tmp_path / "served", text)

        def make(robot: Any) -> composer.Environment:
            environment = make_environment(robot)
            environment.reset()
            (spec,) = {s.shape for s in environment.observation_spec().values()}
            assert spec == (1, 1)
            return environment

        play = {"backlash": {"width": 0.2, "load_side": 1.0, "armature": 0.001}}
        found = asked(
            tmp_path, model, play, make=make, policy=lambda timestep: np.zeros(1), episodes=3
        )
        given, mended = found.outcomes
        assert given.tracking is not None
        assert mended.tracking is not None
        assert mended.tracking.mean > 1.5 * given.tracking.mean


FOOT = """<mujoco model="hopper"><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="trunk" pos="0 0 0.3"><freejoint/><geom size="0.1" mass="3"/>
    <body name="shank" pos="0 0 -0.1"><joint name="knee" axis="0 1 0"/>
      <geom name="foot" type="capsule" fromto="0 0 0 0 0 -0.15" size="0.05" mass="0.5" PRIORITY/>
    </body></body>
  </worldbody><actuator><position joint="knee" kp="20" kv="1" ctrlrange="-1 1"/></actuator>
</mujoco>"""


class TestGround:
    @staticmethod
    def _slides(tmp_path: Path, priority: str) -> gap.PolicyGap:
        from walkerkit.tasks import Stand

        model = pendulum(tmp_path / "robot", FOOT.replace("PRIORITY", priority))
        robot = load_robot(model)
        folder = saved(tmp_path / "result", robot, {"ground_friction": {"friction": -0.5}})
        return gap.policy_gap(
            lambda one: composer.Environment(Stand(one.walker()), time_limit=0.1),
            lambda timestep: np.zeros(1),
            folder,
            model=model,
            episodes=3,
        )

    def test_a_floor_with_numbers_of_its_own_is_refused(self, tmp_path: Path) -> None:
        refused(lambda: self._slides(tmp_path, ""), "ground_friction", 'priority="1"')

    def test_feet_of_higher_priority_have_theirs(self, tmp_path: Path) -> None:
        assert len(self._slides(tmp_path, 'priority="1"').outcomes) == 2


class TestFiles:
    def test_the_same_seed_makes_the_same_bytes(self, tmp_path: Path, model: Path) -> None:
        folder = saved(tmp_path / "result", model, {**ROUGH, **LATE})
        written = []
        for name in ("one", "other"):
            found = gap.policy_gap(make_environment, policy, folder, model=model, episodes=3)
            found.save(tmp_path / name)
            written.append([p.read_bytes() for p in sorted((tmp_path / name).glob("policy.*"))])
        assert written[0] == written[1]
        other = gap.policy_gap(make_environment, policy, folder, model=model, episodes=3, seed=7)
        assert other.to_json().encode() != written[0][1]

    def test_what_policy_json_says(self, tmp_path: Path, model: Path) -> None:
        found = asked(tmp_path, model, {**ROUGH, **LATE})
        found.save(tmp_path / "out")
        content = json.loads((tmp_path / "out" / "policy.json").read_text())
        assert content["blamed"] == ["sensor_delay"]
        assert content["seeds"] == [0, 1, 2, 3]
        assert [one["effect"] for one in content["effects"]] == ["sensor_delay", "viscous_friction"]
        (mended,) = [one for one in content["variants"] if one["kind"] == "mended"]
        assert mended["falls"]["count"] == 4
        assert mended["falls"]["low"] < 0.6 < mended["falls"]["high"] == 1.0
        page = (tmp_path / "out" / "policy.html").read_text()
        assert "What breaks this policy is sensor_delay" in page

    def test_seeds_are_paired(self, tmp_path: Path, model: Path) -> None:
        """The first observation of each seed is that of the robot as given."""
        first: list[float] = []

        def watching(timestep: Any) -> Any:
            if timestep.first():
                first.append(float(np.ravel(next(iter(timestep.observation.values())))[0]))
            return policy(timestep)

        asked(tmp_path, model, {**ROUGH, **LATE}, policy=watching)
        starts = np.array(first).reshape(4, 4)
        assert (starts == starts[0]).all()
        assert len(set(starts[0])) == 4


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "parts"),
        [
            ({"episodes": 2}, ("episodes is 2", "3 or more")),
            ({"seconds": -1.0}, ("seconds is -1.0",)),
            ({"measure": "height"}, ("measure is 'height'", "return, falls, tracking")),
            ({"margin": 0.0}, ("margin is 0.0",)),
            ({"effects": ["armature"]}, ("'armature' was not named", "sensor_delay")),
            ({"measure": "tracking"}, ("nothing is tracked",)),
            ({"policy": lambda t: np.zeros(3)}, ("3 numbers", "an action has (1,)")),
            ({"policy": lambda t: np.array([np.nan])}, ("returned nan",)),
            ({"policy": lambda t: t.nothing}, ("raised AttributeError", "TimeStep")),
            ({"policy": 3}, ("an object of type int",)),
            ({"policy": "walk.zip"}, ("walk.zip", ".onnx")),
            ({"policy": "walk.onnx"}, ("walk.onnx: no such file",)),
            ({"policy": "no_such_module:walk"}, ("cannot import 'no_such_module'",)),
            ({"make": "environment.py"}, ("package.module:callable",)),
            ({"make": 3}, ("an object of type int",)),
            ({"make": lambda robot: robot.nothing}, ("raised AttributeError", "as given")),
            ({"make": lambda robot: robot.walker()}, ("random_state",)),
        ],
    )
    def test_each_says_what_to_do(
        self, tmp_path: Path, model: Path, options: Any, parts: tuple[str, ...]
    ) -> None:
        refused(lambda: asked(tmp_path, model, LATE, **options), *parts)

    def test_a_folder_needs_the_model(self, tmp_path: Path, model: Path) -> None:
        folder = saved(tmp_path / "result", model, LATE)
        refused(lambda: gap.policy_gap(make_environment, policy, folder), "Give as `model`")
        refused(
            lambda: gap.policy_gap(make_environment, policy, tmp_path, model=model),
            "is no folder of a diagnosis",
        )
        refused(lambda: gap.policy_gap(make_environment, policy, 3, model=model), "type int")  # type: ignore[arg-type]

    def test_an_episode_has_to_end(self, tmp_path: Path, model: Path) -> None:
        def make(robot: Any) -> composer.Environment:
            return composer.Environment(Balance(robot.walker()))

        found = asked(tmp_path, model, ROUGH, make=make, seconds=0.5)
        assert found.outcomes[0].episodes[0].seconds == pytest.approx(0.5)

    def test_nothing_named_breaks_nothing(self, tmp_path: Path, model: Path) -> None:
        folder = saved(tmp_path / "result", model, LATE)
        content = json.loads((folder / "diagnosis.json").read_text())
        (folder / "diagnosis.json").write_text(json.dumps({**content, "effects": []}))
        refused(
            lambda: gap.policy_gap(make_environment, policy, folder, model=model),
            "nothing was named there",
        )
