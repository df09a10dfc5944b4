"""Robot files: what is the robot in them, and that nothing of it is lost on the way."""

from __future__ import annotations

import warnings

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.locomotion.arenas import floors

from tests.walkers.robots import ARM, DOG, DOG_HOME, DOG_JOINTS, Drive, write
from walkerkit.actuators import IdealPdActuatorCfg, XmlMotorActuatorCfg
from walkerkit.walkers import MjcfWalker
from walkerkit.walkers.robot_file import read_robot

PHYSICS = """
    body_mass body_inertia body_ipos body_iquat body_pos body_quat jnt_pos jnt_axis jnt_range
    jnt_limited jnt_stiffness jnt_type dof_armature dof_damping dof_frictionloss qpos0
    qpos_spring geom_pos geom_quat geom_friction geom_solref geom_solimp geom_contype
    geom_conaffinity geom_condim site_pos site_quat tendon_range actuator_gear actuator_gainprm
    actuator_biasprm actuator_ctrlrange actuator_forcerange actuator_dynprm
"""


def compiled(robot):
    return mujoco.MjModel.from_xml_string(robot.root.to_xml_string(), robot.root.get_assets())


def attached(robot):
    """Compiles it in one of dm_control's arenas."""
    arena = floors.Floor()
    frame = arena.mjcf_model.attach(robot.root)
    if robot.floating:
        frame.add("freejoint")
    return mjcf.Physics.from_mjcf_model(arena.mjcf_model)


def assert_same_physics(model, reference, tolerance=1e-14):
    for name in PHYSICS.split():
        np.testing.assert_allclose(
            getattr(model, name), getattr(reference, name), atol=tolerance, rtol=0, err_msg=name
        )


def robot_of(folder, body, *, head='<compiler angle="radian"/>', tail="", **options):
    text = f"<mujoco model='robot'>{head}<worldbody>{body}</worldbody>{tail}</mujoco>"
    return read_robot(write(folder, text), **options)


LINK = '<geom size="0.1" mass="1"/>'


class TestWhatIsTheRobot:
    def test_floating(self, tmp_path):
        robot = read_robot(write(tmp_path, DOG))
        assert robot.floating
        assert robot.root_body.name == "trunk"
        assert list(robot.places.items()) == list(zip(DOG_JOINTS, range(8), strict=True))
        assert robot.root.find("joint", "root") is None
        assert len(robot.root.worldbody.geom) == 0
        assert set(robot.left_out) == {"geom floor", "light sun"}
        np.testing.assert_array_equal(robot.keyframes["home"], DOG_HOME)
        np.testing.assert_array_equal(robot.keyframes[""], np.zeros(8))
        np.testing.assert_array_equal(robot.poses["home"][0], [0, 0, 0.29])
        np.testing.assert_array_equal(robot.poses[""][0], [0, 0, 0.5])
        assert len(robot.root.keyframe.key) == 0
        attached(robot)

    def test_fixed(self, tmp_path):
        robot = read_robot(write(tmp_path, ARM))
        assert not robot.floating
        assert robot.root_body.name == "base"
        assert robot.root.find("geom", "table") is not None
        assert robot.left_out == ()
        assert robot.poses == {}
        assert_same_physics(compiled(robot), mujoco.MjModel.from_xml_string(ARM))
        attached(robot)

    def test_the_tree_with_most_joints(self, tmp_path):
        body = f"""
          <body name="ball"><freejoint/>{LINK}</body>
          <body name="door"><joint name="hinge"/>{LINK}</body>
          <body name="arm" pos="1 0 0"><joint name="a"/>{LINK}
            <body name="hand"><joint name="b"/>{LINK}</body></body>"""
        robot = robot_of(tmp_path, body)
        assert robot.root_body.name == "arm"
        assert not robot.floating
        assert list(robot.places) == ["hinge", "a", "b"]
        assert robot.left_out == ("body ball",)
        attached(robot)
        robot = robot_of(tmp_path, body, root_body="hand")
        assert (robot.root_body.name, robot.floating) == ("hand", False)
        robot = robot_of(tmp_path, body, root_body="ball")
        assert (robot.root_body.name, robot.floating) == ("ball", True)
        assert list(robot.places) == []
        assert set(robot.left_out) == {"body door", "body arm", "body hand"}
        attached(robot)

    def test_what_floats_takes_no_scene_along(self, tmp_path):
        body = f"""<geom name="floor" type="plane" size="1 1 1"/><site name="mark"/>
          <camera name="far"/><light name="sun"/>
          <body name="target" mocap="true"><geom name="t" size="0.1"/><site name="goal"/></body>
          <body name="crate"><joint name="slide" type="slide"/>
            <geom name="crate" size="0.1"/></body>
          <body name="trunk" pos="1 2 3" quat="0 1 0 0"><freejoint/><geom name="trunk" size="0.1"/>
            <site name="imu"/><body name="leg"><joint name="hip"/>{LINK}
              <body name="foot"><joint name="ankle"/>{LINK}</body></body></body>"""
        tail = """
          <contact><pair geom1="trunk" geom2="crate"/><pair name="p" geom1="trunk" geom2="floor"/>
            <exclude name="e" body1="world" body2="leg"/>
            <exclude name="k" body1="leg" body2="foot"/>
          </contact>
          <equality><weld name="w" body1="trunk" body2="target"/><joint name="j" joint1="slide"/>
            <connect name="c" body1="foot" body2="world" anchor="0 0 0"/></equality>
          <tendon><fixed name="far"><joint joint="slide" coef="1"/><joint joint="hip" coef="1"/>
            </fixed><fixed name="near"><joint joint="hip" coef="1"/></fixed></tendon>
          <actuator><motor name="push" joint="slide"/><motor name="pull" tendon="near"/></actuator>
          <sensor><framepos name="s1" objtype="site" objname="imu" reftype="body" refname="target"/>
            <framezaxis name="s2" objtype="body" objname="world" reftype="site" refname="imu"/>
            <jointpos name="s3" joint="slide"/><jointpos name="s4" joint="hip"/></sensor>
          <keyframe><key name="home" qpos="0.7  4 5 6 1 0 0 0  0.1 0.2"/></keyframe>"""
        robot = robot_of(tmp_path, body, tail=tail)
        assert robot.root_body.name == "trunk"
        np.testing.assert_array_equal(robot.keyframes["home"], [0.1, 0.2])
        np.testing.assert_array_equal(robot.poses["home"][0], [4, 5, 6])
        np.testing.assert_array_equal(robot.poses[""][1], [0, 1, 0, 0])
        physics = attached(robot)
        names = [physics.model.id2name(i, "sensor") for i in range(physics.model.nsensor)]
        assert names == ["robot/s4"]
        assert physics.model.neq == 1  # the connection to the world, which every arena has
        assert physics.model.nu == 1
        assert physics.model.ntendon == 1
        assert physics.model.npair == 0
        assert physics.model.nexclude == 1
        gone = {one.split()[1] for one in robot.left_out}
        scene = "floor mark far sun target t goal crate p e w j push s1 s2 s3"
        assert gone == set(scene.split())

    def test_several_bodies_stay_with_what_is_fixed(self, tmp_path):
        body = f"""<body name="left"><joint name="l"/>{LINK}</body>
          <body name="right"><joint name="r"/>{LINK}</body>
          <body name="aim" mocap="true">{LINK}</body>"""
        robot = robot_of(tmp_path, body)
        assert robot.root_body.name == "left"
        assert list(robot.places) == ["l", "r"]
        assert robot.left_out == ("body aim",)
        attached(robot)

    def test_made_to_float(self, tmp_path):
        robot = read_robot(write(tmp_path, ARM), floating=True)
        assert robot.floating
        assert robot.left_out == ("geom table",)
        np.testing.assert_array_equal(robot.poses[""][0], [0, 0, 0.1])
        attached(robot)

    def test_made_to_stay(self, tmp_path):
        robot = read_robot(write(tmp_path, DOG), floating=False)
        assert not robot.floating
        assert attached(robot).model.nv == 8

    def test_a_free_joint_keeps_what_hampers_it(self, tmp_path):
        """As where a default class was meant for the hinges and reaches the free joint, too."""
        text = DOG.replace('<freejoint name="root"/>', '<joint name="root" type="free"/>')
        path = write(tmp_path, text)
        assert dict(read_robot(path).free_joint) == {"damping": 0.05, "armature": 0.01}
        cfg = IdealPdActuatorCfg(joint_names_expr=(".*_hip",), stiffness=25.0, damping=0.5)
        environment = composer.Environment(Drive(MjcfWalker.from_file(path, cfg)), random_state=0)
        environment.reset()
        model = environment.physics.model
        np.testing.assert_array_equal(model.dof_damping[:6], 0.05)
        np.testing.assert_array_equal(model.dof_armature[:6], 0.01)
        (walker,) = environment.task.walkers
        np.testing.assert_array_equal(walker.get_pose(environment.physics)[0], [0, 0, 0.29])
        assert dict(read_robot(write(tmp_path, DOG)).free_joint) == {}

    def test_nameless(self, tmp_path):
        robot = robot_of(
            tmp_path,
            f'<body><freejoint/>{LINK}<body><joint/>{LINK}<body><joint name="b"/>{LINK}</body>'
            "</body></body>",
        )
        assert dict(robot.places) == {"b": 1}
        assert robot.floating
        attached(robot)

    @pytest.mark.parametrize(
        ("body", "text"),
        [
            ("", "no body, so there is no robot"),
            (LINK, "no body, so there is no robot"),
            (f'<body mocap="true">{LINK}</body>', "no body, so there is no robot"),
            ("<body><joint/></body>", "MuJoCo cannot read it: .*mass and inertia"),
        ],
    )
    def test_refused(self, tmp_path, body, text):
        with pytest.raises(ValueError, match=rf"robot\.xml: .*{text}"):
            robot_of(tmp_path, body)

    def test_missing(self, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"none\.xml: no such file"):
            read_robot(tmp_path / "none.xml")

    def test_missing_mesh(self, tmp_path):
        head = '<asset><mesh name="m" file="none.stl"/></asset>'
        with pytest.raises(ValueError, match=r"robot\.xml: MuJoCo cannot read it.*none\.stl"):
            robot_of(tmp_path, '<body><geom type="mesh" mesh="m"/></body>', head=head)

    def test_what_dm_control_cannot_hold(self, tmp_path):
        cloth = """<flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1"
            mass="1" radius="0.01"><edge equality="true"/></flexcomp>"""
        with pytest.raises(ValueError, match=r"robot\.xml: .*flexible body 'cloth'"):
            robot_of(tmp_path, f'<body name="b"><freejoint/>{LINK}{cloth}</body>')


class TestSettings:
    """Whatever a file says of units, frames, inertia and defaults, its numbers arrive."""

    JOINT = '<joint name="j" axis="0 1 0" range="-30 60" ref="10" springref="5" stiffness="2"/>'

    @pytest.mark.parametrize(
        ("head", "body"),
        [
            ("", JOINT),
            ('<compiler angle="degree"/>', JOINT),
            ('<compiler angle="radian"/>', JOINT.replace("-30 60", "-0.5 1")),
            ('<compiler coordinate="local"/>', JOINT),
            ('<compiler autolimits="false"/>', JOINT.replace("<joint", '<joint limited="false"')),
            ('<compiler autolimits="false"/>', JOINT.replace("<joint", '<joint limited="true"')),
            ('<compiler eulerseq="zyx"/>', JOINT + '<site euler="10 20 30"/>'),
            (
                '<compiler inertiafromgeom="true"/>',
                '<inertial pos="1 0 0" mass="9" diaginertia="1 1 1"/>' + JOINT,
            ),
            (
                '<compiler inertiafromgeom="false"/>',
                '<inertial pos="0.1 0 0" mass="9" fullinertia="1 1.1 1.2 0.1 0.2 0.05"/>' + JOINT,
            ),
            ('<compiler boundmass="7" boundinertia="0.4"/>', JOINT),
            (
                '<compiler balanceinertia="true"/>',
                '<inertial pos="0 0 0" mass="2" diaginertia="1 1 9"/>' + JOINT,
            ),
            ('<compiler inertiagrouprange="2 3"/>', JOINT + '<geom size="1" group="2"/>'),
            ('<option gravity="1 0 -3" density="4" viscosity="0.2"/>', JOINT),
            (
                '<default><joint armature="0.3"/><default class="leg"><joint damping="0.7" '
                'axis="1 0 0" range="-20 20"/><geom size="0.2" friction="0.3"/></default>'
                "</default>",
                '<joint name="j" class="leg"/><geom class="leg" pos="0 0 1"/>',
            ),
            (
                "",
                JOINT + '<frame pos="0 0 1" euler="0 0 90"><geom size="0.2" pos="1 0 0"/>'
                '<frame euler="90 0 0"><body name="inner" pos="0 1 0"><joint name="k"/>'
                + LINK
                + '<site pos="1 2 3"/></body><site pos="1 2 3" euler="0 45 0"/></frame></frame>',
            ),
            ("", JOINT + '<geom fromto="0 0 0 0.1 0.2 -0.5" size="0.05" type="capsule"/>'),
        ],
    )
    def test_arrive(self, tmp_path, head, body):
        body = f'<body name="b" pos="1 2 3" euler="0 0 90">{body}{LINK}</body>'
        robot = robot_of(tmp_path, body, head=head)
        reference = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
        model = compiled(robot)
        assert_same_physics(model, reference)
        np.testing.assert_array_equal(model.opt.gravity, reference.opt.gravity)
        attached(robot)

    def test_total_mass_is_settled_before_the_scene_goes(self, tmp_path):
        body = f"""<body name="rock"><joint name="r"/>{LINK}</body>
            <body name="b"><freejoint/>{LINK}<body><joint name="j"/>{LINK}
            <body><joint name="k"/>{LINK}</body></body></body>"""
        with pytest.warns(UserWarning, match="settotalmass"):
            robot = robot_of(tmp_path, body, head='<compiler settotalmass="8"/>')
        np.testing.assert_allclose(compiled(robot).body_mass, [0, 2, 2, 2])

    def test_warnings_come_once(self, tmp_path):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            robot_of(
                tmp_path,
                f'<body><joint name="j"/>{LINK}</body>',
                head='<compiler settotalmass="8"/>',
            )
        assert len(caught) == 1

    def test_joints_behind_child_bodies_in_the_text(self, tmp_path):
        """MuJoCo numbers a body's own joints first, wherever the text has them."""
        body = f"""<body name="a"><body name="b"><joint name="second"/>{LINK}</body>
            <joint name="first"/>{LINK}</body>"""
        tail = '<keyframe><key name="home" qpos="0.1 0.2"/></keyframe>'
        robot = robot_of(tmp_path, body, tail=tail)
        assert dict(robot.places) == {"first": 0, "second": 1}
        walker = MjcfWalker.from_file(
            tmp_path / "robot.xml",
            IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=1.0, damping=0.01),
        )
        assert [joint.name for joint in walker.observable_joints] == ["first", "second"]
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        assert environment.physics.bind(walker.mjcf_model.find("joint", "first")).qpos == 0.1
        assert environment.physics.bind(walker.mjcf_model.find("joint", "second")).qpos == 0.2
        np.testing.assert_array_equal(walker.command.position_target, [0.1, 0.2])

    @pytest.mark.parametrize("by_class", [True, False])
    def test_ball_joints(self, tmp_path, by_class):
        kind = 'class="ball"' if by_class else 'type="ball"'
        body = f"""<body name="a"><joint name="a"/>{LINK}
            <body name="b"><joint name="b" {kind}/>{LINK}
            <body name="c"><joint name="c"/>{LINK}</body></body></body>"""
        robot = robot_of(
            tmp_path,
            body,
            head='<default><default class="ball"><joint type="ball"/></default></default>',
            tail='<keyframe><key name="home" qpos="0.1  0 0 1 0  0.2"/></keyframe>',
        )
        assert dict(robot.places) == {"a": 0, "c": 5}
        walker = MjcfWalker.from_file(
            tmp_path / "robot.xml",
            IdealPdActuatorCfg(joint_names_expr=("a", "c"), stiffness=1.0, damping=0.01),
            home={"c": 0.3},
        )
        np.testing.assert_array_equal(walker.home, [0, 1, 0, 0, 0, 0.3])
        assert [joint.name for joint in walker.observable_joints] == ["a", "c"]
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        np.testing.assert_array_equal(environment.physics.data.qpos, walker.home)
        environment.step([np.zeros(2)])

    def test_names_with_separators(self, tmp_path):
        body = f"""<body name="left/trunk"><freejoint/>{LINK}<body name="left/leg">
            <joint name="left/hip"/>{LINK}</body></body>"""
        tail = '<keyframe><key name="all/home" qpos="0 0 1 1 0 0 0 0.4"/></keyframe>'
        text = f"<mujoco model='a/b'><worldbody>{body}</worldbody>{tail}</mujoco>"
        path = write(tmp_path, text)
        robot = read_robot(path, root_body="left/trunk")
        assert list(robot.places) == ["left\\hip"]
        assert robot.root.model == "a_b"
        walker = MjcfWalker.from_file(
            path,
            IdealPdActuatorCfg(joint_names_expr=(".*hip",), stiffness=1.0, damping=0.01),
            root_body="left/leg",
            home="all/home",
        )
        assert walker.root_body.name == "left\\leg"
        np.testing.assert_array_equal(walker.home, [0.4])
        composer.Environment(Drive(walker), random_state=0).reset()

    def test_model_without_a_name_goes_by_its_file(self, tmp_path):
        text = f"<mujoco><worldbody><body>{LINK}</body></worldbody></mujoco>"
        assert read_robot(write(tmp_path, text, "rex.xml")).root.model == "rex"

    def test_what_arenas_disagree_on_stays_behind(self, tmp_path):
        """Two robots with other looks and sizes fit into one arena, whose own looks stay."""
        scene = """<visual><headlight ambient="{0} 0 0"/><global offwidth="123{1}"/></visual>
          <statistic extent="{1}"/><size memory="{1}M" nuser_geom="{1}" nkey="{1}"/>
          <option cone="pyramidal"/>"""
        arena = floors.Floor()
        for i, name in enumerate(("one", "two"), start=1):
            robot = robot_of(tmp_path, f"<body>{LINK}</body>", head=scene.format(0.1 * i, i))
            robot.root.model = name
            arena.mjcf_model.attach(robot.root)
        physics = mjcf.Physics.from_mjcf_model(arena.mjcf_model)
        np.testing.assert_allclose(physics.model.vis.headlight.ambient, [0.4] * 3)
        assert physics.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC

    def test_includes_and_assets_in_other_folders(self, tmp_path):
        (tmp_path / "parts").mkdir()
        (tmp_path / "meshes").mkdir()
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        lines = [f"v {x} {y} {z}" for x, y, z in corners]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        (tmp_path / "meshes" / "tip.obj").write_text("\n".join(lines))
        write(
            tmp_path / "parts",
            f"<mujocoinclude><body name='limb'><joint name='j'/>{LINK}"
            '<geom type="mesh" mesh="tip"/></body></mujocoinclude>',
            "limb.xml",
        )
        robot = robot_of(
            tmp_path,
            f'<body name="b">{LINK}<include file="parts/limb.xml"/></body>',
            head='<compiler meshdir="meshes"/><asset><mesh file="tip.obj"/></asset>',
        )
        reference = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
        # A mesh is single precision in either way.
        assert_same_physics(compiled(robot), reference, 1e-7)
        attached(robot)

    def test_actuators_that_dm_control_has_no_element_for(self, tmp_path):
        body = f'<body name="b"><joint name="j"/>{LINK}</body>'
        tail = """<actuator><dcmotor name="dc" joint="j" resistance="1" motorconst="0.1"/>
            <position name="late" joint="j" kp="10" delay="0.004" nsample="2"/></actuator>"""
        robot = robot_of(tmp_path, body, tail=tail)
        reference = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
        model = compiled(robot)
        assert_same_physics(model, reference)
        np.testing.assert_array_equal(model.actuator_delay, reference.actuator_delay)
        attached(robot)


URDF = """
<robot name="crane">
  <link name="base"><inertial><mass value="3"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="mast"><inertial><mass value="1"/><origin xyz="0 0 0.1" rpy="0.1 0 0"/>
      <inertia ixx="0.03" iyy="0.02" izz="0.025" ixy="0.001" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision></link>
  <link name="jib"><inertial><mass value="0.8"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="trolley"><inertial><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hook"><inertial><mass value="0.2"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.03"/></geometry></collision></link>
  <joint name="slew" type="continuous"><parent link="base"/><child link="mast"/>
    <origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="luff" type="revolute"><parent link="mast"/><child link="jib"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-1.2" upper="2.1" effort="30" velocity="5"/></joint>
  <joint name="travel" type="prismatic"><parent link="jib"/><child link="trolley"/>
    <origin xyz="0.1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" effort="100" velocity="1"/></joint>
  <joint name="rope" type="fixed"><parent link="trolley"/><child link="hook"/>
    <origin xyz="0 0 -0.4"/></joint>
</robot>
"""


class TestUrdf:
    CFG = IdealPdActuatorCfg(
        joint_names_expr=("slew", "luff", "travel"),
        stiffness={"slew": 20.0, "luff": 20.0, "travel": 200.0},
        damping={"slew": 1.0, "luff": 1.0, "travel": 10.0},
    )

    @pytest.fixture(params=["crane.urdf", "crane.xml"])
    def path(self, tmp_path, request):
        return write(tmp_path, URDF, request.param)

    def test_joints_and_limits(self, path):
        robot = read_robot(path)
        model = compiled(robot)
        assert list(robot.places) == ["slew", "luff", "travel"]
        hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
        assert list(model.jnt_type) == [hinge, hinge, slide]
        assert list(model.jnt_limited) == [0, 1, 1]
        np.testing.assert_array_equal(model.jnt_range[1:], [[-1.2, 2.1], [0, 0.3]])
        np.testing.assert_array_equal(model.jnt_actfrcrange[1:], [[-30, 30], [-100, 100]])
        assert model.dof_damping[0] == 0.1
        assert model.dof_frictionloss[0] == 0.2

    def test_links_stay_bodies(self, path):
        """Also the base, which MuJoCo fuses with its world, and the one behind a fixed joint."""
        robot = read_robot(path)
        assert robot.root_body.name == "base"
        assert [body.name for body in robot.root.find_all("body")] == [
            "base",
            "mast",
            "jib",
            "trolley",
            "hook",
        ]
        np.testing.assert_allclose(compiled(robot).body_mass, [0, 3, 1, 0.8, 0.5, 0.2])

    @pytest.mark.parametrize("floating", [False, True])
    def test_walks(self, path, floating):
        walker = MjcfWalker.from_file(
            path, self.CFG, floating=floating, home={"luff": 0.3, "travel": 0.1}
        )
        assert walker.mjcf_model.model == "crane"
        assert [body.name for body in walker.end_effectors] == ["hook"]
        environment = composer.Environment(Drive(walker, timestep=0.002), random_state=0)
        environment.reset()
        assert environment.physics.model.nv == 3 + 6 * floating
        for _ in range(50):
            environment.step([walker.action_for()])
        assert np.isfinite(environment.physics.data.qpos).all()
        np.testing.assert_allclose(
            environment.physics.bind(walker.observable_joints).qpos, [0, 0.3, 0.1], atol=0.2
        )


def test_trajectory_of_a_robot_that_floats(tmp_path):
    """In degrees, with Euler angles, frames and default classes; attached, as in its own file."""
    text = """<mujoco model="hopper"><compiler eulerseq="zxy" inertiafromgeom="true"/>
      <option timestep="0.003" tolerance="0"/>
      <default><joint damping="0.3" armature="0.011" limited="true"/>
        <geom density="733" solref="0.013 0.9" friction="0.77"/>
        <default class="thin"><geom size="0.0237"/></default></default>
      <worldbody><geom name="floor" type="plane" size="9 9 1" pos="0 0 -0.6"/>
        <body name="trunk" pos="0.1 0.2 0.317" euler="10 20 30"><freejoint/>
          <geom size="0.1 0.07" type="capsule" euler="0 90 17"/>
          <frame pos="0.07 0 -0.1" euler="0 0 33">
          <body name="thigh"><joint name="hip" axis="0 1 0.3" range="-70 33.3" ref="7"/>
            <geom class="thin" type="capsule" fromto="0 0 0 0.03 0 -0.31"/>
            <body name="shin" pos="0.03 0 -0.31"><joint name="knee" axis="0.1 1 0"
              range="-113 -1.7" springref="-40" stiffness="3.1"/>
              <geom class="thin" type="capsule" fromto="0 0 0 0 0.01 -0.29"/></body></body></frame>
        </body></worldbody>
      <actuator><motor name="k" joint="knee" gear="-3.3"/><motor name="h" joint="hip" gear="7.1"/>
      </actuator></mujoco>"""
    path = write(tmp_path, text)
    walker = MjcfWalker.from_file(path, XmlMotorActuatorCfg(joint_names_expr=("hip", "knee")))
    arena = composer.Arena()
    root = arena.mjcf_model
    walker.create_root_joints(arena.attach(walker))
    root.worldbody.add(
        "geom",
        type="plane",
        size=[9, 9, 1],
        pos=[0, 0, -0.6],
        density=733,
        solref=[0.013, 0.9],
        friction=[0.77, 0.005, 0.0001],
    )
    root.option.cone, root.option.noslip_iterations = "pyramidal", 0
    root.option.timestep = 0.003  # PyMJCF takes the shorter one, which is the arena's
    del root.compiler.boundmass, root.compiler.boundinertia  # the frame would weigh 10 mg
    reference = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(reference)
    physics = mjcf.Physics.from_mjcf_model(root)
    walker.after_compile(physics, None)
    with physics.reset_context():
        walker.reinitialize_pose(physics, np.random.RandomState(0))
    random_state = np.random.RandomState(0)
    touched = 0
    for _ in range(500):
        action = random_state.uniform(-1, 1, 2)
        walker.apply_action(physics, action, random_state)
        walker.before_substep(physics, random_state)
        physics.step()
        data.ctrl[:] = action[::-1] / [-3.3, 7.1]  # an effort of 1 N·m each where none is limited
        mujoco.mj_step(reference, data)
        touched += data.ncon > 0
        np.testing.assert_allclose(physics.data.qpos, data.qpos, atol=1e-9, rtol=0)
    assert touched > 50
