import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_drive import load_rig
from walkerkit.gap.rehearsal.hidden import HIDEABLE
from walkerkit.gap.rehearsal.hidden_draw import draw_hidden, peak_effort
from walkerkit.walkers import LEG_XML

NAMES = ("hip", "thigh", "calf")
PEAKS = {"hip": 6.0, "thigh": 4.0, "calf": 2.0}

# What the effects' sizes may be on the leg: kp 60, kv 3, forcerange 30, 1.95 kg.
RANGES = {
    "viscous_friction": {"damping": (0.15, 0.6)},
    "coulomb_friction": {"frictionloss": (0.3, 1.5)},
    "armature": {"armature": (0.004, 0.025)},
    "command_delay": {"delay": (0.004, 0.016)},
    "sensor_delay": {"delay": (0.004, 0.016)},
    "position_gain": {"delta_kp": (9.0, 21.0)},
    "velocity_gain": {"delta_kd": (0.75, 1.8)},
    "torque_constant": {"alpha": (0.1, 0.25)},
    "effort_limit": {"forcerange": (0.8, 4.5)},
    "payload": {"mass": (0.0975, 0.39)},
    "base_tilt": {"roll": (0.0, 0.15), "pitch": (0.0, 0.15)},
    "encoder_offset": {"offset": (0.03, 0.1)},
    "torque_bias": {"bias": (0.5, 2.02)},
    "parallel_spring": {"stiffness": (1.0, 5.0), "springref": (0.0, 2.6)},
}
SIGNED = ("position_gain", "velocity_gain", "torque_constant", "encoder_offset", "torque_bias")


def draws(effects, count=60, seed=0, model=LEG_XML, **options):
    rng = np.random.default_rng(seed)
    return [draw_hidden(model, rng, effects, **options) for _ in range(count)]


@pytest.mark.parametrize("name", sorted(HIDEABLE))
def test_sizes_are_realistic_and_differ(name):
    drawn = draws([name], peak_effort=PEAKS)
    for parameter, (low, high) in RANGES[name].items():
        values = np.array(
            [v for d in drawn for k, v in d.values.items() if k.split("/")[-1] == parameter]
        )
        sizes = np.abs(values)
        assert sizes.min() >= low - 1e-9
        assert sizes.max() <= high + 1e-9
        assert np.ptp(sizes) > 0.5 * (high - low)
        if name in SIGNED:
            assert (values > 0).any()
            assert (values < 0).any()


@pytest.mark.parametrize("name", [n for n, h in HIDEABLE.items() if h.on == "joints"])
def test_sits_in_one_joint_about_half_the_time_else_in_all(name):
    drawn = draws([name], peak_effort=PEAKS)
    if name.endswith("delay"):
        assert all(d.joints == ("*",) for d in drawn)
        return
    single = [d.joints for d in drawn if len(d.joints) == 1]
    assert set(single) == {(n,) for n in NAMES}
    assert all(d.joints == NAMES for d in drawn if len(d.joints) > 1)
    assert 15 < len(single) < 45
    several = next(d for d in drawn if len(d.joints) == 3)
    assert len(set(several.values.values())) == len(several.values)


def test_payload_sits_where_joints_feel_it():
    # The hip's own centre of mass is nearly on the hip's axis: a payload there changes nothing.
    assert {d.bodies for d in draws(["payload"])} == {("thigh",), ("calf",)}


def test_tilts_in_every_direction_by_a_bounded_angle():
    angles = np.array([[d.values["roll"], d.values["pitch"]] for d in draws(["base_tilt"])])
    assert np.all(np.linalg.norm(angles, axis=1) > 0.05 - 1e-9)
    assert np.all((angles > 0).any(axis=0) & (angles < 0).any(axis=0))


def test_springs_pull_towards_poses_inside_the_range():
    model, _ = load_rig(LEG_XML)
    for drawn in draws(["parallel_spring"]):
        for joint in drawn.joints:
            lower, upper = model.joint(joint).range
            assert lower < drawn.value("springref", joint) < upper


def test_draws_every_effect_alike_and_effort_limit_only_with_peaks():
    without = [d.effect for d in draws(None, 260)]
    assert set(without) == set(HIDEABLE) - {"effort_limit"}
    assert max(map(without.count, without)) < 45
    assert {d.effect for d in draws(None, 260, peak_effort=PEAKS)} == set(HIDEABLE)
    two = [d.effect for d in draws(["armature", "payload"])]
    assert set(two) == {"armature", "payload"}


def test_same_generator_same_draws():
    assert draws(None, 20, seed=4) == draws(None, 20, seed=4)
    assert draws(None, 20, seed=4) != draws(None, 20, seed=5)


ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="slider"><joint name="rail" type="slide" axis="1 0 0"/><geom size="0.1" mass="2"/>
    <body name="arm"><joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/></body></body>
</worldbody><actuator>
  <position joint="rail" kp="100"/><position joint="shoulder" kp="20"/>
</actuator></mujoco>
"""


@pytest.fixture
def arm(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    return file


def test_scales_without_effort_limits_velocity_gains_and_joint_ranges(arm):
    for drawn in draws(None, 100, model=arm):
        assert all(np.isfinite(v) for v in drawn.values.values())
        if drawn.effect == "velocity_gain":
            # There is no velocity gain to take away from.
            assert min(drawn.values.values()) > 0
        if drawn.effect == "coulomb_friction" and "shoulder" in drawn.joints:
            assert 0.1 <= drawn.value("frictionloss", "shoulder") <= 0.5


def test_peak_effort_is_the_largest_of_all_recordings():
    def recording(name, effort):
        columns = {
            "a/b/position": np.zeros(2),
            "a/b/position_target": np.zeros(2),
            "a/b/effort": np.array(effort),
        }
        return Recording(name=name, time=np.arange(2) * 0.002, columns=columns)

    peaks = peak_effort([recording("one", [1.0, -3.0]), recording("two", [2.0, 0.0])])
    assert peaks == {"a/b": 3.0}


def test_refuses_what_it_cannot_draw(tmp_path, arm):
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=r"'armatur' cannot be hidden.*'armature'"):
        draw_hidden(LEG_XML, rng, ["payload", "armatur"])
    with pytest.raises(InputError, match="effects is empty"):
        draw_hidden(LEG_XML, rng, [])
    with pytest.raises(
        InputError, match="peak effort of hip, thigh, calf, and peak_effort has none"
    ):
        draw_hidden(LEG_XML, rng, ["effort_limit"])
    with pytest.raises(InputError, match="peak_effort has hip; give peak_effort=peak_effort"):
        draw_hidden(LEG_XML, rng, ["effort_limit"], peak_effort={"hip": 1.0})
    nameless = tmp_path / "nameless.xml"
    nameless.write_text(ARM.replace(' name="arm"', "").replace(' name="slider"', ""))
    with pytest.raises(InputError, match="no named body that its joints move"):
        draw_hidden(nameless, rng, ["payload"])
    assert mujoco.MjModel.from_xml_path(str(nameless)).nbody == 3
