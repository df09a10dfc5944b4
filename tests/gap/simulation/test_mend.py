"""Mended models: written as MJCF and actuators.json, loaded again, moving as the trial did."""

import json
import os
import struct
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import windows
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.robot import Measurement
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar
from walkerkit.gap.simulation.trials import Trials

DATA = Path(os.environ.get("WALKERKIT_DATA", Path(__file__).parents[4] / "shared" / "data"))
NEAR = {"rtol": 1e-6, "atol": 1e-6}
TETRAHEDRON = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

MODELS = {
    "degrees": """
<mujoco><worldbody>
  <body name="thigh" euler="0 0 30"><joint name="hip" axis="1 0 0" range="-70 80" ref="11"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
    <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" range="-90 90" stiffness="1"
      springref="20" damping="0.1"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/>
    </body></body></worldbody>
<actuator><position name="h" joint="hip" kp="50" kv="2"/>
  <position name="k" joint="knee" kp="20" kv="1"/></actuator></mujoco>""",
    "defaults": """
<mujoco><compiler angle="radian" autolimits="true"/>
<default><joint damping="0.3" armature="0.01"/><geom density="3000"/>
  <default class="leg"><joint range="-1.5 1.5" frictionloss="0.05"/>
    <position kp="40" kv="1" forcerange="-9 9"/>
    <default class="low"><joint axis="0 1 0" stiffness="0.7" springref="0.2"/></default></default>
</default>
<worldbody><body name="thigh" childclass="leg"><joint name="hip" axis="1 0 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
    <body name="shank" pos="0 0 -0.3"><joint name="knee" class="low"/>
      <geom type="box" size="0.02 0.03 0.1" pos="0.01 0 -0.1"/>
      <geom type="sphere" size="0.03" pos="0 0.01 -0.2"/></body></body></worldbody>
<actuator><position class="leg" name="h" joint="hip"/>
  <position class="leg" name="k" joint="knee" kp="25"/></actuator></mujoco>""",
    "old drives": """
<mujoco><compiler angle="radian"/><option timestep="0.004" integrator="implicitfast"/>
<worldbody><body name="thigh"><joint name="hip" axis="1 0 0" stiffness="2" springref="0.4"
      frictionloss="0.2" damping="0.2"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
    <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" frictionloss="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/>
    </body></body></worldbody>
<actuator>
  <general name="h" joint="hip" gear="3" biastype="affine" gainprm="6" biasprm="0.5 -5 -0.3"
    ctrlrange="-1 1" forcerange="-4 4" delay="0.012" nsample="4" interp="linear"/>
  <position name="k" joint="knee" kp="20" kv="1" delay="0.008" nsample="2"/></actuator>
</mujoco>""",
}
MODELS["on a rail"] = (
    MODELS["degrees"]
    .replace('range="-70 80" ref="11"', 'type="slide" range="-0.7 0.8" ref="0.1" stiffness="3"')
    .replace("<actuator>", '<actuator><pid joint="hip" kp="0" input="pos vel ff"/>')
)
JOINTS = ("hip", "knee")
CHANNELS = tuple(
    Channel(joint=joint, signal=signal)
    for signal in ("position", "velocity", "effort")
    for joint in JOINTS
)


def log(joints=JOINTS, kind="position_target"):
    time = 1.0 + np.cumsum(0.005 * np.random.default_rng(0).uniform(0.6, 1.4, 200))
    columns = {}
    for k, joint in enumerate(joints):
        columns[f"{joint}/position"] = 0.2 * np.sin((3 + k) * time) + 0.1
        columns[f"{joint}/{kind}"] = 0.4 * np.sin((5 + 2 * k) * time) + 0.1 * np.sign(
            np.sin((7 + k) * time)
        )
    return Recording(name="log", time=time, columns=columns)


def robot_of(text):
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml")
    return replace(robot, excursions=excursions(robot, [log()], JOINTS))


def replayed(robot, trials=None, recording=None):
    recording = recording or log()
    channels = [channel for channel in CHANNELS if channel.joint in recording.joints]
    replay = Replay(robot, windows(recording, 0.4), channels)
    predicted = replay.predict(trials or Trials(robot, 1))
    assert np.isfinite(predicted).all()
    return predicted


def structure_of(robot, names=tuple(CATALOGUE), joints=JOINTS):
    terms = candidate_terms([CATALOGUE[name] for name in names], [robot], joints)
    return Structure(terms, (robot,))


def some(structure, part=0.31):
    """Values with many digits, off their zeros and inside their bounds."""
    lower, upper = structure.bounds
    starts = np.array([slot.parameter.starts[-1] for slot in structure.slots])
    return np.clip(structure.zero + part * 1.2345678901 * (starts - structure.zero), lower, upper)


def saved(robot, folder, name="model.xml", taken=None):
    write_model(robot, folder / name, taken)
    content = json.dumps(sidecar({name: robot}, []), allow_nan=False)
    (folder / FILE).write_text(content, encoding="utf-8")
    return folder / name


def loaded(path):
    return with_sidecar(load_robot(path), path)


def composed(path):
    """The file read by PyMJCF instead."""
    root = mjcf.from_path(str(path))
    spec = mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
    return with_sidecar(robot_from_spec(spec, str(path)), path)


@pytest.mark.parametrize("model", MODELS)
class TestModels:
    def test_all_effects_at_once(self, model, tmp_path):
        robot = robot_of(MODELS[model])
        structure = structure_of(robot)
        values = some(structure)
        expected = replayed(robot, structure.trials(robot, values[None]))
        assert np.abs(expected - replayed(robot)).max() > 0.01
        mended = mend(structure.trials(robot, values[None]))
        np.testing.assert_allclose(replayed(mended), expected, **NEAR)
        path = saved(mended, tmp_path)
        np.testing.assert_allclose(replayed(loaded(path)), expected, **NEAR)
        if "pid" not in MODELS[model]:  # which PyMJCF does not know
            np.testing.assert_allclose(replayed(composed(path)), expected, **NEAR)

    def test_the_given_robot_is_left_alone(self, model):
        robot = robot_of(MODELS[model])
        before, text = replayed(robot), robot.spec.to_xml()
        structure = structure_of(robot)
        mend(structure.trials(robot, some(structure)[None]))
        np.testing.assert_array_equal(replayed(robot), before)
        assert robot.spec.to_xml() == text

    def test_zero_mends_nothing(self, model):
        robot = robot_of(MODELS[model])
        structure = structure_of(robot)
        mended = mend(structure.trials(robot, structure.zero[None]))
        np.testing.assert_allclose(replayed(mended), replayed(robot), atol=1e-12)
        assert mended.spec.to_xml() == robot.spec.to_xml()

    def test_a_mended_robot_can_be_mended_again(self, model, tmp_path):
        robot = robot_of(MODELS[model])
        first = structure_of(robot, ["sensor_delay", "torque_constant", "command_delay", "payload"])
        once = loaded(saved(mend(first.trials(robot, some(first)[None])), tmp_path))
        once = replace(once, excursions=robot.excursions)
        second = structure_of(once, ["command_delay", "viscous_friction", "sensor_delay"])
        values = some(second)
        expected = replayed(once, second.trials(once, values[None]))
        (tmp_path / "again").mkdir()
        twice = loaded(saved(mend(second.trials(once, values[None])), tmp_path / "again"))
        np.testing.assert_allclose(replayed(twice), expected, **NEAR)


def test_order_of_effects_on_one_drive_is_kept(tmp_path):
    robot = robot_of(MODELS["degrees"])
    names = ["torque_constant", "torque_bias", "effort_limit", "position_gain"]
    for order in (names, names[::-1]):
        structure = structure_of(robot)
        terms = [next(t for t in structure.terms if t.effect.name == name) for name in order]
        structure = Structure(tuple(terms), (robot,))
        values = some(structure)
        expected = replayed(robot, structure.trials(robot, values[None]))
        again = loaded(saved(mend(structure.trials(robot, values[None])), tmp_path))
        np.testing.assert_allclose(replayed(again), expected, **NEAR)


class TestWhatIsWritten:
    """The mended MJCF says it in MuJoCo's own words."""

    def mended(self, model, tmp_path, **values):
        robot = robot_of(MODELS[model])
        terms = []
        chosen = []
        for name, sites in values.items():
            for site, numbers in sites.items():
                (term,) = candidate_terms([CATALOGUE[name]], [robot], JOINTS)
                terms.append(replace(term, sites=(site,), shared=False))
                chosen.extend(numbers)
        mended = mend(Structure(tuple(terms), (robot,)).trials(robot, np.array([chosen])))
        return mujoco.MjModel.from_xml_path(str(saved(mended, tmp_path)))

    def test_of_joints(self, tmp_path):
        model = self.mended(
            "degrees",
            tmp_path,
            viscous_friction={"knee": [0.2]},
            coulomb_friction={"hip": [0.3]},
            armature={"hip": [0.02]},
            parallel_spring={"knee": [3.0, 0.1]},
            encoder_offset={"hip": [0.05]},
        )
        np.testing.assert_allclose(model.dof_damping, [0, 0.3])
        np.testing.assert_allclose(model.dof_frictionloss, [0.3, 0])
        np.testing.assert_allclose(model.dof_armature, [0.02, 0])
        np.testing.assert_allclose(model.jnt_stiffness, [0, 4])
        spring = (1 * np.deg2rad(20) + 3 * 0.1) / 4
        np.testing.assert_allclose(model.qpos_spring, [0.05, spring], atol=1e-7)
        np.testing.assert_allclose(model.qpos0, [np.deg2rad(11) + 0.05, 0])
        np.testing.assert_allclose(
            model.jnt_range, [np.deg2rad([-70, 80]) + 0.05, np.deg2rad([-90, 90])], atol=1e-7
        )

    def test_of_drives(self, tmp_path):
        model = self.mended(
            "defaults",
            tmp_path,
            position_gain={"knee": [5.0]},
            velocity_gain={"knee": [0.4]},
            torque_constant={"hip": [0.1]},
            torque_bias={"knee": [0.7]},
            effort_limit={"knee": [6.0]},
            command_delay={"hip": [0.0057]},
        )
        np.testing.assert_allclose(model.actuator_gainprm[:, 0], [44, 30])
        np.testing.assert_allclose(
            model.actuator_biasprm[:, :3], [[0, -44, -1.1], [0.7, -30, -1.4]], atol=1e-12
        )
        np.testing.assert_allclose(model.actuator_forcerange, [[-9.9, 9.9], [-6, 6]])
        np.testing.assert_allclose(model.actuator_delay, [0.0057, 0])
        np.testing.assert_array_equal(model.actuator_history, [[4, 1], [0, 0]])

    @pytest.mark.parametrize(("steps", "made"), [(0.4, 0.0), (0.6, 1.0), (1.4, 1.4)])
    def test_a_delay_of_less_than_a_step_is_none_or_one(self, tmp_path, steps, made):
        step = 0.002
        model = self.mended("defaults", tmp_path, command_delay={"hip": [steps * step]})
        assert model.opt.timestep == step
        np.testing.assert_allclose(model.actuator_delay, [made * step, 0], atol=1e-15)
        assert model.actuator_history[0, 0] == (np.ceil(made) + 1 if made else 0)

    @pytest.mark.parametrize("more", ["", '<compiler inertiafromgeom="true"/>'])
    def test_of_bodies_and_the_world(self, tmp_path, monkeypatch, more):
        text = MODELS["defaults"].replace("<default>", f"{more}<default>", 1)
        monkeypatch.setitem(MODELS, "defaults", text)
        plain = mujoco.MjModel.from_xml_string(text)
        model = self.mended(
            "defaults", tmp_path, payload={"shank": [0.123456]}, base_tilt={"*": [0.0, 0.1]}
        )
        np.testing.assert_allclose(model.body_mass - plain.body_mass, [0, 0, 0.123456], atol=1e-7)
        np.testing.assert_allclose(model.body_inertia, plain.body_inertia, rtol=1e-6)
        np.testing.assert_allclose(model.body_ipos, plain.body_ipos, atol=1e-8)
        np.testing.assert_allclose(
            model.opt.gravity, [-9.81 * np.sin(0.1), 0, -9.81 * np.cos(0.1)], rtol=1e-7
        )


def png(colour):
    """A picture of one pixel."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    pixel = zlib.compress(b"\0" + bytes(colour))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixel) + chunk(b"IEND", b"")


ASSETS = """
<mujoco><compiler angle="radian" meshdir="{meshdir}" texturedir="pictures"/>
<asset>
  <mesh name="a" file="left/part.obj"/><mesh name="b" file="right/part.obj"/>
  <mesh file="right/own.obj"/><mesh name="again" file="left/part.obj" scale="2 2 2"/>
  <texture name="skin" type="2d" file="skin.png"/><material name="skin" texture="skin"/>
  <texture name="sky" type="skybox" fileright="r/sky.png" fileleft="l/sky.png" fileup="skin.png"
    filedown="skin.png" filefront="skin.png" fileback="skin.png"/>
  <hfield name="ground" file="ground.png" size="1 1 0.1 0.1"/>
</asset>
<worldbody><geom type="hfield" hfield="ground"/>
  <body name="thigh"><joint name="hip" axis="1 0 0"/><geom type="mesh" mesh="a" material="skin"/>
    <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0"/>
      <geom type="mesh" mesh="b"/><geom type="mesh" mesh="own"/><geom type="mesh" mesh="again"/>
    </body></body></worldbody>
<actuator><position joint="hip" kp="50" kv="20"/><position joint="knee" kp="50" kv="20"/></actuator>
</mujoco>"""


@pytest.fixture
def assets(tmp_path):
    """A model with assets of the same file name in several folders; the mesh folder's place."""
    folder = tmp_path / "given"
    for name, size in {"left/part": 0.2, "right/part": 0.1, "right/own": 0.15}.items():
        path = folder / "parts" / f"{name}.obj"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TETRAHEDRON.format(size))
    for name, colour in {"skin": (9, 8, 7), "r/sky": (1, 2, 3), "l/sky": (4, 5, 6)}.items():
        path = folder / "pictures" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(png(colour))
    (folder / "parts" / "ground.png").write_bytes(png((100, 100, 100)))
    return folder


class TestAssets:
    def same(self, model, given):
        for name in ("mesh_vert", "hfield_data", "body_inertia"):
            np.testing.assert_allclose(getattr(model, name), getattr(given, name), rtol=1e-6)
        np.testing.assert_array_equal(model.tex_data, given.tex_data)
        np.testing.assert_array_equal(model.geom_dataid, given.geom_dataid)
        return True

    @pytest.mark.parametrize("absolute", [False, True], ids=["relative", "absolute"])
    def test_files_of_one_name_stay_apart(self, assets, tmp_path, monkeypatch, absolute):
        meshdir = str(assets / "parts") if absolute else "parts"
        (assets / "leg.xml").write_text(ASSETS.format(meshdir=meshdir))
        given = mujoco.MjModel.from_xml_path(str(assets / "leg.xml"))
        monkeypatch.chdir(assets)  # the path may be relative
        robot = load_robot("leg.xml")
        structure = structure_of(robot, ["payload", "armature"])
        mended = mend(structure.trials(robot, some(structure, part=0.0)[None]))
        (tmp_path / "out").mkdir()
        path = saved(mended, tmp_path / "out")
        # What was given is not needed any more.
        assets.rename(tmp_path / "moved")
        monkeypatch.chdir(tmp_path)
        assert self.same(mujoco.MjModel.from_xml_path(str(path)), given)
        assert composed(path).model.nmesh == given.nmesh
        files = sorted(file.name for file in (tmp_path / "out" / "assets").iterdir())
        assert files == [
            "ground.png",
            "own.obj",
            "part.obj",
            "part_2.obj",
            "skin.png",
            "sky.png",
            "sky_2.png",
        ]

    def test_two_models_share_a_folder(self, assets, tmp_path):
        (assets / "leg.xml").write_text(ASSETS.format(meshdir="parts"))
        other = tmp_path / "other"
        (other / "meshes").mkdir(parents=True)
        (other / "meshes" / "own.obj").write_text(TETRAHEDRON.format(0.3))
        (other / "arm.xml").write_text(
            "<mujoco><compiler meshdir='meshes'/><asset><mesh file='own.obj'/></asset><worldbody>"
            "<body><joint name='hip'/><geom type='mesh' mesh='own'/></body></worldbody></mujoco>"
        )
        out, taken = tmp_path / "out", {}
        out.mkdir()
        sources = {
            "a.xml": assets / "leg.xml",
            "b.xml": other / "arm.xml",
            "c.xml": assets / "leg.xml",
        }
        for name, source in sources.items():
            write_model(load_robot(source), out / name, taken)
        for name, source in sources.items():
            given = mujoco.MjModel.from_xml_path(str(source))
            assert self.same(mujoco.MjModel.from_xml_path(str(out / name)), given)
        assert sorted(f.name for f in (out / "assets").glob("own*")) == ["own.obj", "own_2.obj"]

    def test_of_a_walker_made_by_a_callable(self, assets, tmp_path, monkeypatch):
        monkeypatch.chdir(assets)
        monkeypatch.setattr(sys, "path", list(sys.path))
        monkeypatch.delitem(sys.modules, "mended_walker", raising=False)
        (assets / "mended_walker.py").write_text(
            "from dm_control import mjcf\n"
            "def make():\n"
            "    root = mjcf.RootElement()\n"
            "    root.option.integrator = 'implicitfast'\n"
            "    for k, side in enumerate(('left', 'right')):\n"
            "        root.asset.add('mesh', name=side, file=f'parts/{side}/part.obj')\n"
            "        body = root.worldbody.add('body', name=side)\n"
            "        joint = body.add('joint', name=('hip', 'knee')[k], axis=[0, 1, 0])\n"
            "        body.add('geom', type='mesh', mesh=side)\n"
            "        root.actuator.add('position', joint=joint, kp=0.5, kv=0.05)\n"
            "    return root\n"
        )
        robot = load_robot("mended_walker:make")
        robot = replace(robot, excursions=excursions(robot, [log()], JOINTS))
        structure = structure_of(robot, ["payload", "command_delay"])
        values = some(structure)
        expected = replayed(robot, structure.trials(robot, values[None]))
        path = saved(mend(structure.trials(robot, values[None])), tmp_path)
        monkeypatch.chdir(tmp_path)
        for again in (loaded(path), composed(path)):
            np.testing.assert_allclose(replayed(again), expected, **NEAR)
        np.testing.assert_allclose(load_robot(path).model.mesh_vert, robot.model.mesh_vert)

    def test_a_model_without_any_gets_no_folder(self, tmp_path):
        write_model(robot_of(MODELS["degrees"]), tmp_path / "model.xml")
        assert [file.name for file in tmp_path.iterdir()] == ["model.xml"]


def test_the_composer_leg(tmp_path):
    robot = load_robot("walkerkit.walkers:Leg")
    recording = log(("hip", "thigh", "calf"))
    lower, upper = (
        robot.model.jnt_range.mean(axis=1) - 0.3,
        robot.model.jnt_range.mean(axis=1) + 0.3,
    )
    columns = {}
    for k, joint in enumerate(recording.joints):
        for signal in ("position", "position_target"):
            wave = recording.columns[f"{joint}/{signal}"]
            columns[f"{joint}/{signal}"] = lower[k] + (upper[k] - lower[k]) * (wave + 0.6) / 1.2
    recording = replace(recording, columns=columns)
    robot = replace(robot, excursions=excursions(robot, [recording], recording.joints))
    structure = structure_of(robot, joints=recording.joints)
    values = some(structure, part=0.2)
    expected = replayed(robot, structure.trials(robot, values[None]), recording)
    path = saved(mend(structure.trials(robot, values[None])), tmp_path)
    for again in (loaded(path), composed(path)):
        np.testing.assert_allclose(replayed(again, recording=recording), expected, **NEAR)


@pytest.mark.skipif(not (DATA / "robots").is_dir(), reason="robots not available")
@pytest.mark.parametrize("file", ["unitree_go1/go1.xml", "unitree_h1/h1.xml"])
def test_a_robot_hung_up(file, tmp_path):
    spec = mujoco.MjSpec.from_file(str(DATA / "robots" / file))
    spec.delete(next(j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE))
    for key in list(spec.keys):
        spec.delete(key)
    robot = robot_from_spec(spec, file)
    joints = tuple(robot.joints)[1:3]
    drives = robot.joints[joints[0]].drives
    kind = drives[0].kind if drives else "effort"
    recording = log(joints, f"{kind}_target")
    robot = replace(robot, excursions=excursions(robot, [recording], joints))
    structure = structure_of(robot, joints=joints)
    values = some(structure, part=0.1)
    channels = [Channel(joint=joint, signal="position") for joint in joints]

    def moved(robot, trials=None):
        replay = Replay(robot, windows(recording, 0.2)[:2], channels)
        return replay.predict(trials or Trials(robot, 1))

    expected = moved(robot, structure.trials(robot, values[None]))
    mended = mend(structure.trials(robot, values[None]))
    np.testing.assert_allclose(moved(mended), expected, **NEAR)
    again = loaded(saved(mended, tmp_path))
    np.testing.assert_allclose(moved(again), expected, **NEAR)
    assert again.joints.keys() == mended.joints.keys() >= robot.joints.keys()
    np.testing.assert_allclose(again.model.mesh_vert, robot.model.mesh_vert)


def test_a_model_whose_compiler_undoes_a_change_is_refused():
    text = MODELS["degrees"].replace("<worldbody>", '<compiler boundmass="0.3"/><worldbody>', 1)
    robot = robot_of(text)
    (term,) = candidate_terms([CATALOGUE["payload"]], [robot], JOINTS)
    structure = Structure((replace(term, sites=("shank",)),), (robot,))
    with pytest.raises(RuntimeError, match="keep `body_mass` from being changed; look for boundm"):
        mend(structure.trials(robot, np.array([[-0.2]])))


def test_only_one_variant_makes_a_model():
    robot = robot_of(MODELS["degrees"])
    with pytest.raises(ValueError, match="3 variants make 3 models; mend them one by one"):
        mend(Trials(robot, 3))


def test_a_body_that_was_fused_with_its_parent(tmp_path):
    text = MODELS["degrees"].replace(
        '<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/>',
        '<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/>'
        '<body name="foot" pos="0 0 -0.2"><geom size="0.03"/></body>',
    )
    robot = robot_of(text.replace("<worldbody>", '<compiler fusestatic="true"/><worldbody>', 1))
    assert robot.bodies == ("thigh", "shank")
    structure = structure_of(robot, ["payload"])
    values = some(structure)
    expected = replayed(robot, structure.trials(robot, values[None]))
    again = loaded(saved(mend(structure.trials(robot, values[None])), tmp_path))
    np.testing.assert_allclose(replayed(again), expected, **NEAR)


class TestSidecar:
    @pytest.fixture
    def mended(self):
        robot = robot_of(MODELS["old drives"])
        return replace(
            robot,
            hold="linear",
            measurement={
                "hip": Measurement(position_delay=0.011, effort_scale=0.9, effort_offset=-0.3),
                "knee": Measurement(),
            },
        )

    def test_says_what_mjcf_cannot(self, mended):
        named = [{"effect": "sensor_delay"}]
        content = sidecar({"model.xml": mended}, named)
        assert json.loads(json.dumps(content)) == content
        assert content["schema"] == 1
        assert content["effects"] == named
        entry = content["models"]["model.xml"]
        assert entry["hold"] == "linear"
        assert entry["measurement"] == {
            "hip": {"position_delay": 0.011, "effort_scale": 0.9, "effort_offset": -0.3}
        }
        assert entry["command"]["knee"] == {"position": {"slope": 1.0, "offset": 0.0}}
        slope, offset = entry["command"]["hip"]["position"].values()
        # 6 u + 0.5 − 5·3 q is zero at the target.
        assert 6 * (slope * 0.7 + offset) + 0.5 == pytest.approx(15 * 0.7)

    def test_is_read_for_its_model_alone(self, mended, tmp_path):
        path = saved(mended, tmp_path)
        again = loaded(path)
        assert again.hold == "linear"
        assert again.measured("hip") == mended.measured("hip")
        assert again.measured("knee") == Measurement()
        write_model(mended, tmp_path / "other.xml")
        other = load_robot(tmp_path / "other.xml")
        assert with_sidecar(other, tmp_path / "other.xml") is other
        (tmp_path / FILE).unlink()
        assert with_sidecar(other, path) is other

    def test_targets_keep_their_meaning_when_the_law_changed(self, tmp_path):
        robot = robot_of(MODELS["old drives"])
        structure = structure_of(robot, ["torque_bias", "position_gain"])
        mended = mend(structure.trials(robot, some(structure)[None]))
        again = loaded(saved(mended, tmp_path))
        for joint in JOINTS:
            given, read = robot.joints[joint].drives[0], again.joints[joint].drives[0]
            assert read.control(0.37) == pytest.approx(given.control(0.37))
            assert read.stiffness > given.stiffness

    def test_of_two_drives_of_a_kind_the_first_counts(self, tmp_path):
        text = MODELS["degrees"].replace(
            "</actuator>", '<position joint="hip" kp="2" gear="7"/></actuator>'
        )
        robot = robot_of(text)
        again = loaded(saved(robot, tmp_path))
        assert again.joints["hip"].drive("position").slope == 1.0
        np.testing.assert_allclose(replayed(again), replayed(robot), **NEAR)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (
                lambda c: "{",
                r"is no actuators\.json of schema 1 \(JSONDecodeError: .*\)\. Write it",
            ),
            (lambda c: "[]", "is no actuators.json of schema 1"),
            (lambda c: json.dumps(c | {"models": 3}), "is no actuators.json"),
            (lambda c: json.dumps({}), r"KeyError: 'models'"),
            (lambda c: json.dumps(c).replace("0.011", '"soon"'), "ValueError: .*soon"),
            (lambda c: json.dumps(c).replace("0.011", "NaN"), "nan is not a finite number"),
            (lambda c: json.dumps(c).replace("position_delay", "delay"), "unexpected keyword"),
            (
                lambda c: json.dumps(c).replace('"knee"', '"knie"'),
                "joint 'knie' is not in the model",
            ),
        ],
    )
    def test_refuses_what_it_did_not_write(self, mended, tmp_path, change, message):
        path = saved(mended, tmp_path)
        content = json.loads((tmp_path / FILE).read_text())
        (tmp_path / FILE).write_text(change(content))
        with pytest.raises(InputError, match=message) as refusal:
            loaded(path)
        assert str(tmp_path / FILE) in str(refusal.value)
        assert "\n" not in str(refusal.value)
