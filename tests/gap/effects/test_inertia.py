"""Inertia that the model lacks."""

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import LEG, PLAIN
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.trials import Trials


class TestArmature(EffectContract):
    name = "armature"

    def plant(self, machine):
        machine.model.joint("hip").armature += 0.017
        return {"hip": [0.017]}


class TestPayload(EffectContract):
    name = "payload"

    def plant(self, machine):
        machine.model.body("shank").mass += 0.21
        return {"shank": [0.21]}


class TestComOffset(EffectContract):
    name = "com_offset"

    def plant(self, machine):
        machine.model.body("shank").ipos += (0.013, -0.008, -0.024)
        return {"shank": [0.013, -0.008, -0.024]}


class TestWhatIsWelded:
    """A tool or a foot: it has no joint of its own, but can carry something."""

    @pytest.fixture
    def robot(self):
        text = LEG.format(**PLAIN)
        foot = '<body name="foot" pos="0 0 -0.2"><geom size="0.02" mass="0.1"/></body>'
        stand = '<body name="stand"><geom size="0.1" pos="0 2 0"/></body>'
        text = text.replace("</body></body>", foot + "</body></body>" + stand)
        return robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml")

    def test_carries_a_payload_but_has_the_com_offset_of_what_it_is_welded_to(self, robot):
        joints = list(robot.joints)
        assert CATALOGUE["payload"].sites(robot, joints) == ("thigh", "shank", "foot")
        assert CATALOGUE["com_offset"].sites(robot, joints) == ("thigh", "shank")

    def test_a_payload_is_felt_where_it_is(self, robot):
        trials = Trials(robot, 1)
        CATALOGUE["payload"].apply(trials, "foot", np.array([[0.3]]))
        mended = mend(trials)
        assert mended.model.body("foot").mass[0] == pytest.approx(0.4)
        assert mended.model.body("shank").mass[0] == robot.model.body("shank").mass[0]


SETTINGS = {
    "of geoms": "",
    "of all geoms": '<compiler inertiafromgeom="true"/>',
    "of a total mass": '<compiler settotalmass="3"/>',
}
STATED = (
    '<inertial mass="0.7" pos="0.01 0 -0.12" quat="0.9 0.1 0 0.2" diaginertia="3e-3 2e-3 1e-3"/>'
)


class TestPayloadBesideComOffset:
    """Both change one body's inertia, in either order, whatever the model says of it."""

    @pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass':UserWarning")
    @pytest.mark.parametrize("names", [("payload", "com_offset"), ("com_offset", "payload")])
    @pytest.mark.parametrize("inertial", ["", STATED])
    @pytest.mark.parametrize("setting", SETTINGS)
    def test_mended_body_has_both(self, setting, inertial, names):
        text = LEG.format(**PLAIN).replace("<option", SETTINGS[setting] + "<option")
        shank = '<body name="shank" pos="0 0 -0.3">'
        robot = robot_from_spec(
            mujoco.MjSpec.from_string(text.replace(shank, shank + inertial)), "leg.xml"
        )
        values = {"payload": [0.3], "com_offset": [0.01, 0.02, -0.03]}
        trials = Trials(robot, 1)
        for name in names:
            CATALOGUE[name].apply(trials, "shank", np.array([values[name]]))
        mended = mend(trials)
        before, after = robot.model.body("shank"), mended.model.body("shank")
        assert after.mass == pytest.approx(before.mass + 0.3)
        np.testing.assert_allclose(after.ipos, before.ipos + values["com_offset"])
        np.testing.assert_allclose(after.inertia, before.inertia)
        turn = np.abs(np.dot(after.iquat, before.iquat))
        assert turn == pytest.approx(1)
        np.testing.assert_allclose(mended.model.body("thigh").mass, robot.model.body("thigh").mass)


# The joints of a link, and the axes along which its motion feels its centre of mass.
LINKS = {
    "hinge": ('<joint name="j" axis="0 1 0"/>', "xz"),
    "two on one axis": ('<joint name="j" axis="0 1 0"/><joint name="i" axis="0 -1 0"/>', "xz"),
    "oblique": ('<joint name="j" axis="1 1 0"/>', "xyz"),
    "hinge on a slide": (
        '<joint name="j" axis="0 0 1"/><joint name="i" type="slide" axis="1 0 1"/>',
        "xy",
    ),
    "slide": ('<joint name="j" type="slide" axis="1 0 1"/>', ""),
    "ball": ('<joint name="j" axis="0 1 0"/><joint type="ball"/>', "xyz"),
    "across": ('<joint name="j" axis="0 1 0"/><joint name="i" axis="1 0 0"/>', "xyz"),
}


class TestComOffsetIsFelt:
    """Only offsets that the motion feels are parameters, and others change nothing."""

    @pytest.mark.parametrize("link", LINKS)
    @pytest.mark.parametrize("turned", ["", 'quat="0.6 0 0 0.8"'])
    def test_axes(self, link, turned):
        joints, felt = LINKS[link]
        text = f"""
        <mujoco><default><joint armature="0.01"/></default>
        <worldbody><body name="mount" {turned}><body name="link" pos="0 0 1">{joints}
          <inertial mass="0.7" pos="0.02 0.03 -0.1" diaginertia="3e-3 2e-3 1e-3"/></body></body>
        </worldbody></mujoco>"""
        robot = robot_from_spec(mujoco.MjSpec.from_string(text), "link.xml")
        effect = CATALOGUE["com_offset"]
        assert effect.sites(robot, ["j"]) == (("link",) if felt else ())
        assert "".join(p.name for p in effect.parameters(robot, "link")) == felt
        for axis, name in enumerate("xyz"):
            moved = robot.spec.copy().compile()
            moved.body("link").ipos[axis] += 0.02
            mujoco.mj_setConst(moved, mujoco.MjData(moved))
            changes = []
            for model in (robot.model, moved):
                data = mujoco.MjData(model)
                state = np.random.default_rng(axis)
                mujoco.mj_integratePos(model, data.qpos, state.normal(size=model.nv), 1.0)
                data.qvel[:] = state.normal(size=model.nv)
                mujoco.mj_forward(model, data)
                changes.append(data.qacc.copy())
            assert (np.abs(changes[1] - changes[0]).max() > 1e-3) == (name in felt)

    def test_a_body_on_its_only_axis_is_left_out(self):
        text = """
        <mujoco><worldbody><body name="wheel"><joint name="j" axis="0 1 0"/>
          <inertial mass="0.7" pos="0 0 0" diaginertia="3e-3 2e-3 1e-3"/></body>
        </worldbody></mujoco>"""
        robot = robot_from_spec(mujoco.MjSpec.from_string(text), "wheel.xml")
        assert CATALOGUE["com_offset"].sites(robot, ["j"]) == ()
