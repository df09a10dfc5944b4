"""Robots: what can be loaded, what is read from it, and what is refused with which words."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.mended import Mended
from walkerkit.gap.simulation.robot import Excursion, Measurement
from walkerkit.walkers import LEG_XML

DATA = Path(os.environ.get("WALKERKIT_DATA", Path(__file__).parents[4] / "shared" / "data"))
MODEL = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="rail"><geom size="0.1"/>
    <body name="cart"><joint name="cart" type="slide" axis="1 0 0"/><geom size="0.1"/>
      <body name="head"><joint name="neck" type="ball"/><geom size="0.1"/></body>
      <body><joint axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/>
        <body name="arm"><joint name="arm" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.2"/>
          <body name="plate"><geom size="0.1"/></body></body></body></body></body>
</worldbody><actuator>
  <position name="hold" joint="arm" kp="30" kv="1"/><motor joint="arm"/><motor joint="cart"/>
  <position joint="arm" kp="5" delay="0.01" nsample="6"/>
</actuator></mujoco>
"""
WALKER = (
    "<body name='{0}'><freejoint/><geom size='1'/>"
    "<body><joint name='{0}_leg'/><geom size='1'/></body></body>"
)


@pytest.fixture
def robot():
    return robot_from_spec(mujoco.MjSpec.from_string(MODEL), "cart.xml")


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module that can be imported from the working folder for as long as the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))

    def write(name, text):
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, name, raising=False)

    return write


class TestJoints:
    def test_scalar_joints_with_names_in_kinematic_order(self, robot):
        assert list(robot.joints) == ["cart", "arm"]
        arm = robot.joints["arm"]
        assert (arm.id, arm.qpos, arm.dof, arm.slide) == (3, 6, 5, False)
        assert robot.joints["cart"].slide

    def test_drives_are_found_by_what_they_take(self, robot):
        arm = robot.joints["arm"]
        assert [drive.actuator for drive in arm.drives] == [0, 1, 3]
        assert arm.drive("position") is arm.drives[0]
        assert arm.drive("effort") is arm.drives[1]
        assert arm.drive("velocity") is None

    def test_bodies_are_those_that_move_or_are_welded_to_one_and_have_names(self, robot):
        assert robot.bodies == ("cart", "head", "arm", "plate")

    def test_defaults_where_nothing_is_known(self, robot):
        assert robot.measured("arm") == Measurement()
        assert robot.excursion("arm") == Excursion()
        known = replace(robot, excursions={"arm": Excursion(lower=-0.5, upper=1.5)})
        assert known.excursion("arm").range == 2.0

    def test_names_joints_that_are_missing_and_the_closest(self, robot):
        robot.check_joints(["arm", "cart"], "log.csv")
        with pytest.raises(
            InputError,
            match=r"^log\.csv: joint 'kart' is not in the model cart\.xml "
            r"\(did you mean 'cart'.*\?\)\. Rename the columns `kart/…` or the joint, or leave "
            r"them out\.$",
        ):
            robot.check_joints(["arm", "kart"], "log.csv")
        with pytest.raises(InputError, match="which has 'cart', 'arm'"):
            robot.check_joints(["wheel_7"], "log.csv")


RUBBING = """
<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
  <joint name="slider" type="slide" frictionloss="1"/><geom size="0.05" mass="1"/>
</body></worldbody></mujoco>
"""


class TestRefined:
    @pytest.mark.parametrize("factor", [1, 4])
    def test_step_is_shorter_and_the_original_is_left_alone(self, robot, factor):
        finer = robot.refined(factor)
        assert finer.model.opt.timestep == pytest.approx(0.002 / factor)
        assert robot.model.opt.timestep == robot.spec.option.timestep == 0.002
        assert finer.model.opt.integrator == robot.model.opt.integrator
        assert finer.joints is robot.joints

    def test_delays_last_as_long_as_before(self, robot):
        finer = robot.refined(4)
        assert finer.model.actuator_delay[3] == robot.model.actuator_delay[3] == 0.01
        assert finer.model.actuator_history[3, 0] == 24

    @pytest.mark.parametrize(("given", "other"), [("Euler", 3), ("implicitfast", 0)])
    def test_other_integrator(self, given, other):
        text = MODEL.replace("<worldbody>", f'<option integrator="{given}"/><worldbody>', 1)
        robot = robot_from_spec(mujoco.MjSpec.from_string(text), "cart.xml")
        assert robot.refined(2, other_integrator=True).model.opt.integrator == other

    def test_dry_friction_holds_what_it_can_hold(self):
        robot = robot_from_spec(mujoco.MjSpec.from_string(RUBBING), "rubbing.xml")
        assert robot.has_dry_friction
        crept = []
        for one in (robot.refined(2), robot.refined(2, as_dry_as_it_goes=True)):
            data = mujoco.MjData(one.model)
            data.qfrc_applied[:] = 0.8  # of what it takes to slide
            mujoco.mj_step(one.model, data, 2000)
            crept.append(float(np.abs(data.qpos[0])))
        assert crept[1] < 0.1 * crept[0]
        assert robot.spec.joint("slider").solref_friction[0] == 0.02


class TestCoarsened:
    def test_step_is_longer_and_the_original_is_left_alone(self, robot):
        coarser = robot.coarsened(2)
        assert coarser.model.opt.timestep == pytest.approx(0.004)
        assert robot.model.opt.timestep == robot.spec.option.timestep == 0.002
        assert coarser.joints is robot.joints
        assert coarser.refined(2).model.opt.timestep == pytest.approx(0.002)

    def test_delays_last_as_long_as_before(self, robot):
        coarser = robot.coarsened(2)
        lags = []
        for model in (robot.model, coarser.model):
            data = mujoco.MjData(model)
            while data.actuator_force[3] < 25.0:
                data.ctrl[3] = 10.0
                mujoco.mj_step(model, data)
            lags.append(data.time)
        assert lags[1] == pytest.approx(lags[0], abs=coarser.model.opt.timestep)
        assert lags[0] >= 0.01


class TestSources:
    def reference(self):
        return mujoco.MjModel.from_xml_string(MODEL)

    def same(self, robot):
        model, reference = robot.model, self.reference()
        np.testing.assert_allclose(model.body_mass, reference.body_mass)
        np.testing.assert_allclose(model.actuator_gainprm, reference.actuator_gainprm)
        assert model.njnt == reference.njnt
        return True

    def test_a_file(self, tmp_path):
        path = tmp_path / "my cart.xml"
        path.write_text(MODEL)
        for source in (path, str(path)):
            robot = load_robot(source)
            assert self.same(robot)
            assert robot.path == path
            assert robot.stem == "my cart"

    @pytest.mark.parametrize(
        "body",
        [
            "return TEXT",
            "return mujoco.MjSpec.from_string(TEXT)",
            "return mjcf.from_xml_string(TEXT)",
            "return types.SimpleNamespace(mjcf_model=mjcf.from_xml_string(TEXT))",
        ],
        ids=["text", "MjSpec", "PyMJCF", "walker"],
    )
    def test_a_callable(self, module, body):
        module(
            "maker",
            f"import mujoco, types\nfrom dm_control import mjcf\nTEXT = {MODEL!r}\n"
            f"def cart():\n    {body}\n",
        )
        robot = load_robot("maker:cart")
        assert self.same(robot)
        assert robot.path is None
        assert robot.stem == "cart"
        assert robot.source == "maker:cart"

    def test_a_walker_keeps_its_home(self):
        walker, plain = load_robot("walkerkit.walkers:Leg"), load_robot(LEG_XML)
        assert walker.model.key("home").qpos.any()
        np.testing.assert_array_equal(walker.model.key_qpos, plain.model.key_qpos)
        np.testing.assert_array_equal(
            Mended(walker).walker().upright_pose.qpos, plain.model.key_qpos[0]
        )

    def test_the_composer_leg_is_the_leg_of_the_file(self):
        walker, plain = load_robot("walkerkit.walkers:Leg"), load_robot(LEG_XML)
        assert list(walker.joints) == list(plain.joints) == ["hip", "thigh", "calf"]
        for name in plain.joints:
            assert walker.joints[name].drives[0].kind == "position"
            np.testing.assert_allclose(
                walker.joints[name].drives[0].stiffness, plain.joints[name].drives[0].stiffness
            )

    def test_meshes_of_a_walker_come_along(self, module, tmp_path):
        (tmp_path / "part.obj").write_text(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        )
        module(
            "meshed",
            "from dm_control import mjcf\n"
            "def make():\n"
            "    root = mjcf.RootElement()\n"
            "    root.asset.add('mesh', name='part', file='part.obj')\n"
            "    body = root.worldbody.add('body')\n"
            "    body.add('joint', name='j', axis=[0, 1, 0])\n"
            "    body.add('geom', type='mesh', mesh='part')\n"
            "    return root\n",
        )
        assert load_robot("meshed:make").model.nmeshvert == 4


class TestRefusals:
    def refuse(self, source, match):
        with pytest.raises(InputError, match=match) as refusal:
            load_robot(source)
        assert "\n" not in str(refusal.value)

    def test_a_missing_file(self, tmp_path):
        self.refuse(tmp_path / "leg.xml", r"leg\.xml: no such model file\. Give an MJCF file or")

    @pytest.mark.parametrize(
        ("text", "match"),
        [
            ("<mujoco><worldbody>", r"the model does not compile: .*\. Mend the MJCF"),
            ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "does not compile"),
            ("<mujoco/>", r"the model has no named hinge or slide joint\. Name its joints\."),
            (
                "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>",
                "no named hinge",
            ),
            (
                f"<mujoco><worldbody>{WALKER.format('one')}{WALKER.format('two')}"
                "</worldbody></mujoco>",
                r"2 robots float, 'one', 'two', .*\. Give a model of one robot",
            ),
        ],
    )
    def test_a_model_that_cannot_be_used(self, tmp_path, text, match):
        path = tmp_path / "model.xml"
        path.write_text(text)
        self.refuse(path, match)

    @pytest.mark.parametrize(
        ("source", "match"),
        [
            ("nowhere.at_all:make", r"cannot import 'nowhere\.at_all': .*\. Install it"),
            ("odd:mak", r"odd:mak: 'odd' has no function 'mak' \(did you mean 'make'.*\?\)"),
            ("odd:NUMBER", "'odd' has no function 'NUMBER'"),
            ("odd:make", r"odd:make: returned a int\. Return a walker"),
            ("odd:broken", r"odd:broken: it raised AttributeError: .*'hips'.*\. Mend it"),
            ("odd:needy", r"odd:needy: it raised TypeError: .*missing 1 required"),
            ("odd:text", r"odd:text: it raised ValueError: XML"),
            ("syntax:make", r"cannot import 'syntax': .*line 1"),
        ],
    )
    def test_a_callable_that_cannot_be_used(self, module, source, match):
        module(
            "odd",
            "NUMBER = 3\ndef make():\n    return 3\ndef broken():\n    return NUMBER.hips\n"
            "def needy(x):\n    return x\ndef text():\n    return '<mujoco'\n",
        )
        module("syntax", "def make(:\n")
        self.refuse(source, match)


class TestFloating:
    def test_a_robot_with_nothing_to_stand_on_gets_a_floor(self):
        spec = mujoco.MjSpec.from_string(
            f"<mujoco><worldbody>{WALKER.format('trunk')}</worldbody></mujoco>"
        )
        robot = robot_from_spec(spec, "walker.xml")
        assert robot.base == Base(body="trunk", id=1, qpos=0, dof=0)
        assert list(robot.joints) == ["trunk_leg"]
        assert robot.model.geom("ground").type == mujoco.mjtGeom.mjGEOM_PLANE
        (note,) = robot.notes
        assert "level floor at height 0" in note
        assert "'ground'" in note
        assert "ground" not in [geom.name for geom in spec.geoms]  # the user's own is left alone

    def test_ground_that_is_there_stays_alone(self):
        text = f"<mujoco><worldbody>{{}}{WALKER.format('trunk')}</worldbody></mujoco>"
        for floor in ("<geom type='plane' size='0 0 1'/>", "<body><geom size='1'/></body>"):
            robot = robot_from_spec(mujoco.MjSpec.from_string(text.format(floor)), "walker.xml")
            assert robot.notes == ()
            assert robot.model.ngeom == 3
        untouchable = "<geom type='plane' size='0 0 1' contype='0' conaffinity='0'/>"
        robot = robot_from_spec(mujoco.MjSpec.from_string(text.format(untouchable)), "walker.xml")
        assert len(robot.notes) == 1

    def test_a_thing_that_lies_about_is_no_base(self):
        text = (
            "<mujoco><worldbody><body name='ball'><freejoint/><geom size='.1'/></body>"
            "<body><joint name='j'/><geom size='1'/></body></worldbody></mujoco>"
        )
        assert robot_from_spec(mujoco.MjSpec.from_string(text), "bench.xml").base is None

    def test_a_walker_floats_as_in_an_arena_where_it_is_asked_to(self, module):
        module(
            "made",
            "from walkerkit.walkers import Quadruped\n"
            "def make():\n    return Quadruped(position_controlled=True)\n",
        )
        hung, standing = (load_robot("made:make", floating=floats) for floats in (False, True))
        assert hung.base is None
        assert standing.base is not None
        assert standing.base.body == "quadruped"
        assert standing.model.ngeom == hung.model.ngeom + 1
        assert list(standing.joints) == list(hung.joints)
        assert set(hung.bodies) < set(standing.bodies)

    @pytest.mark.skipif(not (DATA / "robots").is_dir(), reason="robots not available")
    @pytest.mark.parametrize(
        ("file", "base"), [("unitree_go1/go1.xml", "trunk"), ("unitree_h1/h1.xml", "pelvis")]
    )
    def test_published_robots(self, file, base):
        robot = load_robot(DATA / "robots" / file)
        assert robot.base is not None
        assert robot.base.body == base


def test_the_log_of_another_robot_is_told_at_once(robot):
    names = [f"{leg}_{joint}" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh")]
    with pytest.raises(InputError) as refusal:
        robot.check_joints(names, "log.csv")
    assert str(refusal.value) == (
        "log.csv: none of its 8 joints ('FL_hip', 'FL_thigh', 'FR_hip' and 5 more) is in the model "
        "cart.xml, which has 'cart', 'arm'. It is the log of another robot, or names its joints "
        "otherwise: give the model of that robot, or rename the columns `<joint>/…`."
    )
