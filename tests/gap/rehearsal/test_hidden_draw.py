import functools

import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hardware_drive import load_rig
from walkerkit.gap.rehearsal.hidden_draw import draw_hidden, loudness
from walkerkit.gap.rehearsal.hidden_sizes import ASKED, Usual
from walkerkit.gap.rehearsal.hideable import HIDEABLE, NAMELESS
from walkerkit.tasks.excitation import BATTERY
from walkerkit.walkers import LEG_XML

NAMES = ("hip", "thigh", "calf")

# What the effects' sizes may be on the leg: kp 60, kv 3, forcerange 30, 1.95 kg, and a chirp that
# takes 2 to 6 N·m of it.
RANGES = {
    "viscous_friction": {"damping": (0.15, 0.6)},
    "coulomb_friction": {"frictionloss": (0.02, 0.7)},
    "armature": {"armature": (0.004, 0.025)},
    "command_delay": {"delay": (0.004, 0.016)},
    "sensor_delay": {"delay": (0.004, 0.016)},
    "position_gain": {"delta_kp": (9.0, 21.0)},
    "velocity_gain": {"delta_kd": (0.75, 1.8)},
    "torque_constant": {"alpha": (0.1, 0.25)},
    "effort_limit": {"forcerange": (0.5, 4.0)},
    "payload": {"mass": (0.0975, 0.39)},
    "base_tilt": {"roll": (0.0, 0.15), "pitch": (0.0, 0.15)},
    "encoder_offset": {"offset": (0.03, 0.1)},
    "torque_bias": {"bias": (0.04, 1.0)},
    "parallel_spring": {"stiffness": (1.0, 5.0), "springref": (0.0, 2.6)},
    "cogging": {"amplitude": (0.02, 0.6), "periods": (8, 40), "phase": (0, 3.15)},
    "backlash": {"width": (0.01, 0.03)},
    "series_elasticity": {"stiffness": (20.0, 400.0)},
    "clock_skew": {"skew": (0.0005, 0.0015)},
    "strength_drift": {"rate": (0.01, 0.03)},
    "slew_limit": {"rate": (1.5, 5.0)},
}
SIGNED = (
    *("position_gain", "velocity_gain", "torque_constant", "encoder_offset", "torque_bias"),
    *("encoder_gain", "clock_skew"),
)


@functools.cache
def nominal():
    """A chirp of the leg with nothing hidden."""
    time = np.arange(0, 2.0, 0.002)
    reach = np.array([[0.28], [0.6], [0.35]])
    targets = BATTERY["chirp"](
        time,
        lower=(np.array([[0.0], [0.8], [-1.6]]) - reach)[:, 0],
        upper=(np.array([[0.0], [0.8], [-1.6]]) + reach)[:, 0],
        rng=np.random.default_rng(0),
        max_velocity=6.0,
    )
    return run_hardware(LEG_XML, [targets], seed=0, substeps=1)


def draws(effects, count=60, seed=0, model=LEG_XML, **options):
    rng = np.random.default_rng(seed)
    return [draw_hidden(model, rng, effects, **options) for _ in range(count)]


@pytest.mark.parametrize("name", sorted(RANGES))
def test_sizes_are_realistic_and_differ(name):
    drawn = draws([name], nominal=nominal())
    for parameter, (low, high) in RANGES[name].items():
        values = np.array(
            [v for d in drawn for k, v in d.values.items() if k.split("/")[-1] == parameter]
        )
        sizes = np.abs(values)
        assert sizes.min() >= low - 1e-9
        assert sizes.max() <= high + 1e-9
        assert np.ptp(sizes) > 0.3 * (high - low)
        if name in SIGNED:
            assert (values > 0).any()
            assert (values < 0).any()


@pytest.mark.parametrize("name", [n for n, h in HIDEABLE.items() if h.on == "joints"])
def test_sits_in_one_joint_about_half_the_time_else_in_all(name):
    drawn = draws([name], 24, nominal=nominal())
    if HIDEABLE[name].shared:
        assert all(d.joints == ("*",) for d in drawn)
        return
    single = [d.joints for d in drawn if len(d.joints) == 1]
    assert set(single) == {(n,) for n in NAMES}
    assert all(d.joints == NAMES for d in drawn if len(d.joints) > 1)
    assert 5 < len(single) < 19
    several = next(d for d in drawn if len(d.joints) == 3)
    assert len(set(several.values.values())) > 1


def test_sits_in_the_joints_that_it_is_told_to():
    assert {d.joints for d in draws(["cogging"], 5, places=["thigh"])} == {("thigh",)}


def test_sits_on_the_body_that_it_is_told_to():
    for name in ("payload", "com_offset"):
        assert {d.bodies for d in draws([name], 5, places=["hip"])} == {("hip",)}


def test_draws_the_ground_by_name_alone():
    assert all(0.2 < d.values["friction"] < 0.5 for d in draws(["ground_friction"], 5))
    weight = 9.81 * float(load_rig(LEG_XML)[0].body_mass.sum())
    for drawn in draws(["ground_compliance"], 5):
        assert 0.002 < 0.25 * weight / drawn.values["stiffness"] < 0.011


@pytest.mark.parametrize("name", NAMELESS)
def test_draws_what_no_catalogue_names_when_told_to(name):
    assert {d.effect for d in draws([name], 3, nominal=nominal())} == {name}


@pytest.mark.parametrize("name", ["payload", "com_offset"])
def test_a_body_s_sits_where_joints_feel_it(name):
    # The hip's own centre of mass is nearly on the hip's axis: a payload there changes nothing.
    assert {d.bodies for d in draws([name])} == {("thigh",), ("calf",)}


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


def test_draws_every_effect_alike_and_what_is_asked_for_only_with_experiments():
    without = [d.effect for d in draws(None, 400)]
    assert set(without) == set(HIDEABLE) - set(ASKED)
    assert max(map(without.count, without)) < 30
    assert {d.effect for d in draws(None, 400, nominal=nominal())} == set(HIDEABLE)
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
        assert drawn.effect not in ("backlash", "series_elasticity", "supply_sag")
        assert all(np.isfinite(v) for v in drawn.values.values())
        if drawn.effect == "velocity_gain":
            # There is no velocity gain to take away from.
            assert min(drawn.values.values()) > 0
        if drawn.effect == "coulomb_friction" and "shoulder" in drawn.joints:
            assert 0.1 <= drawn.value("frictionloss", "shoulder") <= 0.5


def recording(name, effort, target=0.0):
    effort = np.array(effort)
    columns = {"a/b/position": np.zeros(2), "a/b/position_target": np.array([0.0, target])}
    columns |= {"a/b/velocity": np.array([2.0, 0.5]), "a/b/effort": effort}
    return Recording(name=name, time=np.arange(2) * 0.002, columns=columns)


def test_what_is_usual_is_the_most_of_all_recordings():
    usual = Usual.of([recording("one", [1.0, -3.0]), recording("two", [2.0, 0.0])], ["a/b"])
    assert usual.effort == [3.0]
    assert usual.velocity == [2.0]
    assert usual.power == 4.0


@pytest.mark.parametrize(("target", "asked"), [(0.003, 1.5), (1.0, 2.0)])
def test_no_more_speed_is_asked_than_targets_have_and_joints_reach(target, asked):
    still, moved = recording("one", [0.0, 0.0]), recording("two", [0.0, 0.0], target)
    assert Usual.of([still, moved], ["a/b"]).asked == pytest.approx([asked])


def test_loudness_is_in_standard_deviations_of_the_loudest_signal():
    one, two = recording("one", [1.0, 1.0]), recording("one", [1.1, 0.9])
    assert loudness([one], [two]) == {"a/b": pytest.approx(0.1 / 0.02)}
    assert loudness([one, one], [one, two], ["effort"]) == {"a/b": pytest.approx(0.1 / 0.02)}
    assert loudness([one], [two], ["position"]) == {"a/b": 0.0}


def test_refuses_what_it_cannot_draw(tmp_path, arm):
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=r"'armatur' cannot be hidden.*'armature'"):
        draw_hidden(LEG_XML, rng, ["payload", "armatur"])
    with pytest.raises(InputError, match="of no effects this robot can have none"):
        draw_hidden(LEG_XML, rng, [])
    with pytest.raises(InputError, match=r"effort_limit, .* need nominal=recordings of the robot"):
        draw_hidden(LEG_XML, rng, ["effort_limit"])
    with pytest.raises(InputError, match=r"of backlash this robot can have none; .* an armature"):
        draw_hidden(arm, rng, ["backlash"])
    nameless = tmp_path / "nameless.xml"
    nameless.write_text(ARM.replace(' name="arm"', "").replace(' name="slider"', ""))
    with pytest.raises(InputError, match="no named body that its joints move"):
        draw_hidden(nameless, rng, ["payload"])
    assert mujoco.MjModel.from_xml_path(str(nameless)).nbody == 3
