import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hardware_friction import PRESLIDING
from walkerkit.gap.rehearsal.hardware_log import (
    COUNTS,
    EFFORT_NOISE,
    POSITION_NOISE,
    VELOCITY_NOISE,
)
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hideable import HIDEABLE, NAMELESS

ARM = """
<mujoco model="arm">
  <compiler angle="radian" eulerseq="XYZ"/>
  <option timestep="{timestep}" integrator="implicitfast" gravity="{gravity}"/>
  <worldbody><body name="base" euler="{base}">
    <body name="upper"><joint name="shoulder" axis="0 1 0" {joint}/>
      <inertial pos="0 0.02 -0.1" mass="{mass}" diaginertia="0.01 0.01 0.001"/>
      <body name="lower" pos="0 0 -0.25"><joint name="elbow" axis="0.6 0.8 0" {joint}/>
        <inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.004 0.004 0.0005"/></body></body>
  </body></worldbody>
  <actuator>
    <position name="a" joint="shoulder" kp="{kp}" kv="{kv}" forcerange="{limit}"/>
    <position name="b" joint="elbow" kp="{kp}" kv="{kv}" forcerange="{limit}"/>
  </actuator>
</mujoco>
"""
NUMBERS = {
    "timestep": 0.004,
    "gravity": "0 0 -9.81",
    "base": "0 0 0",
    "joint": 'armature="0.01"',
    "mass": 1.0,
    "kp": 40.0,
    "kv": 2.0,
    "limit": "-20 20",
}
RATE = 250.0
TIME = np.arange(300) / RATE
SMOOTH = (1 - np.cos(2 * np.pi * 2.5 * TIME))[:, None] * [0.3, -0.2] + [0.2, 0.4]
COUNT = 2 * np.pi / COUNTS

SOME = {
    "viscous_friction": {"damping": 0.3},
    "coulomb_friction": {"frictionloss": 0.3},
    "armature": {"armature": 0.02},
    "command_delay": {"delay": 0.01},
    "sensor_delay": {"delay": 0.01},
    "position_gain": {"delta_kp": -8.0},
    "velocity_gain": {"delta_kd": 0.8},
    "torque_constant": {"alpha": 0.2},
    "effort_limit": {"forcerange": 1.5},
    "payload": {"mass": 0.2},
    "base_tilt": {"roll": 0.1, "pitch": -0.05},
    "encoder_offset": {"offset": 0.06},
    "torque_bias": {"bias": 0.5},
    "parallel_spring": {"stiffness": 3.0, "springref": 0.3},
    "asymmetric_friction": {"forward": 0.3, "backward": 0.1},
    "stribeck_friction": {"breakaway": 0.8, "velocity": 0.5},
    "presliding_friction": {"frictionloss": 0.4, "bend": 0.01},
    "load_dependent_friction": {"coefficient": 0.3},
    "directional_efficiency": {"driving": 0.7, "backdriving": 1.3},
    "pose_dependent_friction": {"amplitude": 0.5, "periods": 10.0, "phase": 0.3},
    "quadratic_drag": {"drag": 0.1},
    "cogging": {"amplitude": 0.3, "periods": 12.0, "phase": 0.3},
    "torque_ripple": {"amplitude": 0.3, "periods": 12.0, "phase": 0.3},
    "com_offset": {"x": 0.03, "y": 0.0, "z": 0.02},
    "backlash": {"width": 0.05},
    "series_elasticity": {"stiffness": 40.0},
    "end_stop": {"lower": 0.3, "upper": 0.7},
    "torque_speed_limit": {"saturation_effort": 2.5, "velocity_limit": 6.0},
    "supply_sag": {"sag": 0.15},
    "supply_voltage": {"swing": 0.2},
    "mount_compliance": {"stiffness": 300.0, "damping_ratio": 0.1},
    "strength_drift": {"rate": 0.3},
    "actuator_lag": {"time_constant": 0.02},
    "loop_delay": {"delay": 0.008},
    "sample_and_hold": {"period": 0.03},
    "setpoint_filter": {"time_constant": 0.02},
    "slew_limit": {"rate": 2.0},
    "controller_deadband": {"width": 0.03},
    "integral_action": {"gain": 60.0},
    "velocity_filter": {"time_constant": 0.03},
    "clock_skew": {"skew": 0.02},
    "encoder_gain": {"excess": 0.05},
    "kinematic_error": {"amplitude": 0.01, "periods": 12.0, "phase": 0.3},
    "random_pushes": {"effort": 1.0},
    "pose_bump": {"effort": 0.5, "pose": 0.5, "reach": 0.1},
}
# What an effect of no size is where it is not one of nothing.
_FREE = {
    "effort_limit": {"forcerange": 1e9},
    "directional_efficiency": {"driving": 1.0, "backdriving": 1.0},
    "end_stop": {"lower": -9.0, "upper": 9.0},
    "torque_speed_limit": {"saturation_effort": 1e9, "velocity_limit": 1e9},
    "slew_limit": {"rate": 1e9},
    # Waves, bumps, springs and decays that have no height still have a place or a width.
    **{
        name: SOME[name] | {first: 0.0}
        for name, first in (
            ("stribeck_friction", "breakaway"),
            ("presliding_friction", "frictionloss"),
            ("pose_dependent_friction", "amplitude"),
            ("cogging", "amplitude"),
            ("torque_ripple", "amplitude"),
            ("kinematic_error", "amplitude"),
            ("pose_bump", "effort"),
        )
    },
}
NONE = {name: dict.fromkeys(values, 0.0) for name, values in SOME.items()} | _FREE
# A gear that is a thousand times stiffer than a soft one is as good as none, but has a rotor.
del NONE["series_elasticity"]
# A stand that is stiff weighs something all the same.
del NONE["mount_compliance"]


@pytest.fixture
def write(tmp_path):
    def write_model(**changed):
        file = tmp_path / f"arm{len(list(tmp_path.iterdir()))}.xml"
        file.write_text(ARM.format(**(NUMBERS | changed)))
        return file

    return write_model


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    file = tmp_path_factory.mktemp("written") / "arm.xml"
    file.write_text(ARM.format(**NUMBERS))
    return file


@pytest.fixture(scope="module")
def nominal(written):
    return run(written, substeps=2)


def hide(name, **values):
    places = {"joints": {"joints": ("*",)}, "bodies": {"bodies": ("upper",)}, "world": {}}
    return HiddenEffect(
        effect=name, values=values or SOME[name], **places[{**HIDEABLE, **NAMELESS}[name].on]
    )


def run(model, targets=SMOOTH, *hidden, **options):
    options = {"rate": RATE, "seed": 0} | options
    return run_hardware(model, [targets], hidden=hidden, **options)[0]


def signal(recording, name):
    return np.stack([recording.columns[f"{j}/{name}"] for j in ("shoulder", "elbow")], axis=1)


def rms(a, b):
    return float(np.sqrt(np.mean((a - b) ** 2)))


def native(model_file, targets, substeps):
    """Position at each sample, by MuJoCo's own servos and damping, `substeps` times finer."""
    model = mujoco.MjModel.from_xml_path(str(model_file))
    model.opt.timestep /= substeps
    per_sample = round(1 / RATE / model.opt.timestep)
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = targets[0]
    mujoco.mj_step(model, data, round(1.5 / model.opt.timestep))
    positions, efforts = [], []
    for target in targets:
        data.ctrl[:] = target
        mujoco.mj_forward(model, data)
        positions.append(data.qpos.copy())
        efforts.append(data.actuator_force.copy())
        mujoco.mj_step(model, data, per_sample)
    return np.array(positions), np.array(efforts)


class TestNothingHidden:
    def test_comes_closer_to_native_actuators_with_every_finer_step(self, write):
        file = write(joint='armature="0.01" damping="0.2"')
        position, effort = native(file, SMOOTH, 32)
        errors = []
        for substeps in (1, 2, 4):
            recording = run(file, SMOOTH, substeps=substeps)
            errors.append(
                (
                    rms(signal(recording, "position"), position),
                    rms(signal(recording, "effort"), effort),
                )
            )
        errors = np.array(errors)
        assert np.all(errors[1:] < 0.65 * errors[:-1])
        assert errors[-1, 0] < 2.5e-3

    def test_has_the_model_s_own_friction(self, write):
        bare = run(write())
        for joint, hidden in (
            ('damping="0.3"', hide("viscous_friction")),
            ('frictionloss="0.3"', hide("coulomb_friction")),
            ('stiffness="3" springref="0.3"', hide("parallel_spring")),
        ):
            own = run(write(joint=f'armature="0.01" {joint}'))
            planted = run(write(), SMOOTH, hidden)
            assert rms(signal(own, "effort"), signal(bare, "effort")) > 0.05
            np.testing.assert_allclose(signal(own, "effort"), signal(planted, "effort"), atol=1e-6)

    def test_log_has_the_promised_channels(self, write):
        recording = run(write())
        assert list(recording.columns) == [
            f"{joint}/{name}"
            for joint in ("shoulder", "elbow")
            for name in ("position_target", "position", "velocity", "effort")
        ]
        np.testing.assert_array_equal(recording.time, TIME)
        np.testing.assert_array_equal(signal(recording, "position_target"), SMOOTH)

    def test_starts_settled_at_the_first_target(self, write):
        still = np.tile(SMOOTH[0], (100, 1))
        recording = run(write(), still)
        assert np.abs(signal(recording, "velocity").mean(axis=0)).max() < 5e-3
        assert np.abs(signal(recording, "position") - SMOOTH[0]).max() < 0.05
        assert np.ptp(signal(recording, "position"), axis=0).max() < 3 * COUNT

    def test_noise_and_encoder_grid_are_the_promised_ones(self, write):
        recording = run(write(), np.tile(SMOOTH[0], (2000, 1)))
        counts = signal(recording, "position") / COUNT
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
        assert 0 < np.ptp(counts) < 1e5
        np.testing.assert_allclose(
            signal(recording, "velocity").std(axis=0), VELOCITY_NOISE, rtol=0.1
        )
        np.testing.assert_allclose(signal(recording, "effort").std(axis=0), EFFORT_NOISE, rtol=0.1)
        assert 0 < counts.std(axis=0).max() * COUNT < 2 * POSITION_NOISE + COUNT / 2

    def test_same_seed_same_log_and_other_seed_other_noise_only(self, write):
        file = write()
        one, twin, other = run(file), run(file), run(file, seed=1)
        for name in ("position", "velocity", "effort"):
            np.testing.assert_array_equal(signal(one, name), signal(twin, name))
            assert not np.array_equal(signal(one, name), signal(other, name))
        assert rms(signal(one, "effort"), signal(other, "effort")) < 2 * EFFORT_NOISE

    def test_experiments_do_not_feel_each_other(self, write):
        file = write()
        short = SMOOTH[:120][:, ::-1]
        together = run_hardware(file, [SMOOTH, short], rate=RATE, seed=3, names=["long", "short"])
        assert [r.name for r in together] == ["long", "short"]
        assert [r.time.size for r in together] == [300, 120]
        (alone,) = run_hardware(file, [SMOOTH], rate=RATE, seed=3)
        assert alone.name == "experiment_0"
        for name in ("position", "velocity", "effort"):
            np.testing.assert_array_equal(signal(together[0], name), signal(alone, name))
        (swapped, _) = run_hardware(file, [short, SMOOTH], rate=RATE, seed=3)
        assert rms(signal(swapped, "effort"), signal(together[1], "effort")) < 2 * EFFORT_NOISE

    def test_zero_order_hold_between_samples(self, write):
        # A target that is held for two samples is the same at half the rate.
        file = write()
        slow = SMOOTH[::2]
        fast = run(file, np.repeat(slow, 2, axis=0))
        half = run(file, slow, rate=RATE / 2)
        assert rms(signal(fast, "position")[::2], signal(half, "position")) < 2 * COUNT

    def test_joint_limits_hold(self, write):
        file = write(joint='range="-0.1 0.45" armature="0.01"')
        positions = signal(run(file, SMOOTH), "position")
        assert 0.45 < positions.max() < 0.5
        free = signal(run(write(), SMOOTH), "position")
        assert free.max() > 0.6


@pytest.mark.parametrize("name", sorted([*HIDEABLE, *NAMELESS]))
class TestEveryEffect:
    def test_changes_the_log(self, written, nominal, name):
        hidden = run(written, SMOOTH, hide(name), substeps=2)
        assert set(SOME) == {*HIDEABLE, *NAMELESS}
        changes = {
            "position": POSITION_NOISE + COUNT,
            "effort": EFFORT_NOISE,
        }
        assert any(
            rms(signal(nominal, channel), signal(hidden, channel)) > 3 * noise
            for channel, noise in changes.items()
        )

    def test_of_no_size_changes_nothing(self, written, nominal, name):
        if name in ("series_elasticity", "mount_compliance"):
            pytest.skip("no gear with a rotor is rigid, and no stand without weight")
        hidden = run(written, SMOOTH, hide(name, **NONE[name]), substeps=2)
        for channel in ("position", "velocity", "effort"):
            np.testing.assert_array_equal(signal(nominal, channel), signal(hidden, channel))


class TestLaws:
    @pytest.mark.parametrize(
        ("changed", "effect"),
        [
            ({"kp": 32.0}, "position_gain"),
            ({"kv": 2.8}, "velocity_gain"),
            ({"limit": "-1.5 1.5"}, "effort_limit"),
            ({"mass": 1.2}, "payload"),
            ({"joint": 'armature="0.03"'}, "armature"),
            ({"base": "0.1 -0.05 0"}, "base_tilt"),
        ],
    )
    def test_is_the_model_with_that_number_changed(self, write, changed, effect):
        if effect == "position_gain":
            # MJCF's position servo has both gains; the drive's is kp (u - q) as well.
            assert SOME[effect]["delta_kp"] == 32.0 - NUMBERS["kp"]
        other, hidden = run(write(**changed)), run(write(), SMOOTH, hide(effect))
        for channel in ("position", "velocity", "effort"):
            np.testing.assert_allclose(
                signal(other, channel), signal(hidden, channel), atol=1.01 * COUNT
            )

    def test_gravity_tilts_about_x_then_y_for_large_angles_too(self, write):
        hidden = run(write(), SMOOTH, hide("base_tilt", roll=0.8, pitch=-0.5))
        # Extrinsic XYZ in MuJoCo's capitals: first about the world's x, then about its y.
        turned = run(write(base="0.8 -0.5 0"))
        assert rms(signal(hidden, "effort"), signal(turned, "effort")) < 1e-6

    @pytest.mark.parametrize(
        ("effect", "values", "law"),
        [
            ("viscous_friction", {"damping": 0.8}, lambda v: 0.8 * v),
            ("coulomb_friction", {"frictionloss": 0.6}, lambda v: 0.6 * np.sign(v)),
            ("torque_bias", {"bias": 0.4}, lambda v: -0.4 + 0 * v),
        ],
    )
    def test_balances_the_effort_at_constant_speed(self, write, effect, values, law):
        speed = np.array([0.4, -0.3])
        reached = np.concatenate([np.arange(300), np.arange(300, 0, -1)]) / RATE
        targets = reached[:, None] * speed
        file = write(gravity="0 0 0")
        hidden = run(file, targets, hide(effect, **values), substeps=2)
        # The links turn about different axes: the nominal robot's effort is their Coriolis torque.
        extra = signal(hidden, "effort") - signal(run(file, targets, substeps=2), "effort")
        for window, direction in ((slice(220, 298), 1.0), (slice(520, 598), -1.0)):
            measured = extra[window].mean(axis=0)
            np.testing.assert_allclose(measured, law(direction * speed), atol=5e-3)

    def test_dry_friction_holds_without_creeping(self, write):
        # The target moves by less than breaks the joint loose, and stays there.
        targets = np.tile([0.0, 0.0], (500, 1))
        targets[50:] += 0.5 / NUMBERS["kp"] * np.array([1.0, -1.0])
        recording = run(write(gravity="0 0 0"), targets, hide("coulomb_friction", frictionloss=1.0))
        moved = signal(recording, "position")
        assert np.abs(moved[-100:].mean(axis=0) - moved[:50].mean(axis=0)).max() < 2 * PRESLIDING
        assert np.abs(moved[-100:].mean(axis=0) - moved[100:200].mean(axis=0)).max() < 0.2 * COUNT

    def test_command_delay_is_a_pure_shift_of_everything(self, write):
        file = write()
        nominal, late = run(file), run(file, SMOOTH, hide("command_delay", delay=5 / RATE))
        np.testing.assert_array_equal(signal(late, "position_target"), SMOOTH)
        assert rms(signal(late, "position")[5:], signal(nominal, "position")[:-5]) < 2 * COUNT
        assert rms(signal(late, "effort")[5:], signal(nominal, "effort")[:-5]) < 2 * EFFORT_NOISE
        # Before the first command arrives the robot has always had it.
        assert rms(signal(late, "position")[:5], signal(nominal, "position")[:1]) < 2 * COUNT

    def test_command_delay_may_be_part_of_a_step(self, write):
        file = write()
        whole, part = (
            signal(run(file, SMOOTH, hide("command_delay", delay=d), seed=2), "position")
            for d in (0.012, 0.0123)
        )
        nominal = signal(run(file, seed=2), "position")
        # A small further delay moves the log in proportion.
        share = np.sum((part - whole) * (whole - nominal)) / np.sum((whole - nominal) ** 2)
        assert 0.3 * 0.3 / 12 < share < 3 * 0.3 / 12

    def test_sensor_delay_shifts_the_encoder_s_log_and_nothing_else(self, write):
        file = write()
        nominal, late = run(file), run(file, SMOOTH, hide("sensor_delay", delay=5 / RATE))
        np.testing.assert_array_equal(signal(late, "effort"), signal(nominal, "effort"))
        for channel, noise in (("position", 2 * COUNT), ("velocity", 2 * VELOCITY_NOISE)):
            early = signal(nominal, channel)[:-5]
            assert rms(signal(late, channel)[5:], early) < noise
            assert rms(signal(late, channel)[:-5], early) > 2 * noise

    def test_sensor_delay_interpolates_within_a_step(self, write):
        file = write()
        delay = 0.0103
        late = signal(run(file, SMOOTH, hide("sensor_delay", delay=delay)), "position")
        nominal = signal(run(file), "position")
        shifted = np.stack([np.interp(TIME - delay, TIME, nominal[:, j]) for j in range(2)], axis=1)
        assert rms(late[5:], shifted[5:]) < 1.5 * COUNT

    def test_drive_reports_what_it_believes_under_a_wrong_torque_constant(self, write):
        still = np.tile([0.5, 0.7], (200, 1))
        file = write()
        nominal, weak = run(file, still), run(file, still, hide("torque_constant", alpha=-0.2))
        believed, needed = (signal(r, "effort").mean(axis=0) for r in (weak, nominal))
        # The joints sag a little further, where gravity asks for a little less.
        np.testing.assert_allclose(believed * 0.8, needed, rtol=0.03)

    def test_encoder_offset_is_a_joint_reference_in_log_and_loop(self, write):
        # A joint whose position reads `ref` in the same pose.
        referenced = run(write(joint='armature="0.01" ref="0.06"'))
        hidden = run(write(), SMOOTH, hide("encoder_offset"))
        for channel in ("position", "velocity", "effort"):
            np.testing.assert_allclose(
                signal(referenced, channel), signal(hidden, channel), atol=1.01 * COUNT
            )

    def test_effects_add_up(self, write):
        file = write(gravity="0 0 0")
        still = np.tile([0.5, 0.7], (100, 1))
        both = run(file, still, hide("torque_bias", bias=0.4), hide("torque_bias", bias=0.3))
        np.testing.assert_allclose(signal(both, "effort").mean(axis=0), -0.7, atol=0.01)

    def test_one_joint_alone_can_have_it(self, write):
        hidden = HiddenEffect(effect="torque_bias", joints=("elbow",), values={"bias": 0.5})
        recording = run(write(gravity="0 0 0"), np.tile([0.5, 0.7], (100, 1)), hidden)
        effort = signal(recording, "effort").mean(axis=0)
        np.testing.assert_allclose(effort, [0.0, -0.5], atol=0.01)


def test_a_clock_that_is_fast_has_counted_more(write):
    still = np.tile(SMOOTH, (2, 1))
    file = write()
    nominal = run(file, still)
    skewed = run(file, still, hide("clock_skew", skew=0.02))
    np.testing.assert_array_equal(signal(skewed, "position_target"), still)
    time = np.arange(len(still)) / RATE
    # Efforts jump with the targets, so that between two rows they are those of neither.
    for name, noise in (("position", COUNT), ("effort", 0.3)):
        truth = np.stack(
            [np.interp(time / 1.02, time, signal(nominal, name)[:, j]) for j in range(2)], axis=1
        )
        assert rms(signal(skewed, name), truth) < noise
        assert rms(signal(skewed, name), signal(nominal, name)) > 2 * noise


def test_encoders_in_error_mislead_the_log_alone(write):
    file = write()
    wave = {"amplitude": 0.02, "periods": 9.0, "phase": 0.5}
    nominal, wrong = run(file), run(file, SMOOTH, hide("kinematic_error", **wave))
    np.testing.assert_array_equal(signal(nominal, "effort"), signal(wrong, "effort"))
    q, qd = signal(nominal, "position"), signal(nominal, "velocity")
    shown = q + 0.02 * np.sin(9.0 * q + 0.5)
    assert rms(signal(wrong, "position"), shown) < 2 * COUNT
    slope = 1 + 0.18 * np.cos(9.0 * q + 0.5)
    assert rms(signal(wrong, "velocity"), slope * qd) < 2 * VELOCITY_NOISE


def test_too_steep_encoders_lead_the_servo_short_of_its_target(write):
    still = np.tile([0.5, 0.7], (200, 1))
    hidden = run(write(gravity="0 0 0"), still, hide("encoder_gain", excess=0.25))
    # The log shows the target, where the joint is not.
    np.testing.assert_allclose(signal(hidden, "position").mean(axis=0), [0.5, 0.7], atol=COUNT)


def test_a_shifted_centre_of_mass_is_that_of_another_model(write, tmp_path):
    other = tmp_path / "other.xml"
    other.write_text(ARM.format(**NUMBERS).replace("0 0.02 -0.1", "0.03 0.02 -0.08"))
    hidden = run(write(), SMOOTH, hide("com_offset"))
    for channel in ("position", "effort"):
        np.testing.assert_allclose(signal(run(other), channel), signal(hidden, channel), atol=COUNT)


def test_jitter_is_of_the_time_stamps_alone(write):
    file = write()
    nominal, shaken = run(file), run(file, jitter=1e-4)
    np.testing.assert_array_equal(signal(nominal, "position"), signal(shaken, "position"))
    assert (shaken.time - TIME).std() == pytest.approx(1e-4, rel=0.15)
    assert np.all(np.diff(shaken.time) > 0)
    with pytest.raises(InputError, match=r"jitter is 0\.001 s; give at most 0\.0004 s"):
        run(file, jitter=1e-3)


def test_effort_that_is_read_first_is_that_of_the_target_before(write):
    file = write(gravity="0 0 0")
    targets = np.zeros((100, 2))
    targets[60:, 0] = 0.2
    after, before = (run(file, targets, reads_first=first) for first in (False, True))
    np.testing.assert_array_equal(signal(after, "position"), signal(before, "position"))
    step = NUMBERS["kp"] * 0.2
    for one, row in ((after, 60), (before, 61)):
        effort = signal(one, "effort")[:, 0]
        np.testing.assert_allclose(effort[:row], 0.0, atol=6 * EFFORT_NOISE)
        assert effort[row] > 0.5 * step


def test_pushes_come_at_other_times_in_every_experiment(write):
    file = write()
    pushed = run_hardware(file, [SMOOTH, SMOOTH], hidden=[hide("random_pushes")], rate=RATE, seed=0)
    again = run_hardware(file, [SMOOTH, SMOOTH], hidden=[hide("random_pushes")], rate=RATE, seed=0)
    apart = rms(signal(pushed[0], "effort"), signal(pushed[1], "effort"))
    assert apart > 3 * EFFORT_NOISE
    np.testing.assert_array_equal(signal(pushed[0], "effort"), signal(again[0], "effort"))


def test_a_catch_is_felt_around_its_pose_only(write):
    file = write(gravity="0 0 0")
    bump = hide("pose_bump", effort=-0.6, pose=0.5, reach=0.05)
    for pose, felt in ((0.5, 0.6), (0.8, 0.0)):
        still = np.tile([pose, pose], (150, 1))
        effort = signal(run(file, still, bump), "effort").mean(axis=0)
        np.testing.assert_allclose(effort, felt, atol=0.05)


def test_native_command_delay_of_the_model_is_kept(write, tmp_path):
    delayed = tmp_path / "delayed.xml"
    delayed.write_text(
        ARM.format(**NUMBERS).replace("<position", '<position delay="0.012" nsample="3"')
    )
    own, hidden = run(delayed), run(write(), SMOOTH, hide("command_delay", delay=0.012))
    for channel in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(signal(own, channel), signal(hidden, channel))


TAIL = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0" timestep="0.004"/><worldbody>
  <body name="trunk">{base}<geom size="0.1" mass="1"/>
    <body name="tail"><joint name="tail" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02" mass="1"/></body></body>
</worldbody><actuator><position joint="tail" kp="20" kv="1"/></actuator>
<keyframe><key name="{key}" qpos="{pose}"/></keyframe></mujoco>
"""


def tail_effort(tmp_path, base, targets, pose, key="home"):
    file = tmp_path / "tail.xml"
    file.write_text(TAIL.format(base=base, key=key, pose=pose))
    return run(file, targets[:, None]).columns["tail/effort"]


def test_floating_base_gives_way(tmp_path):
    targets = 0.3 * np.sin(20 * TIME)
    free = tail_effort(tmp_path, "<freejoint/>", targets, "1 2 3 1 0 0 0 0")
    fixed = tail_effort(tmp_path, "", targets, "0")
    assert np.abs(free).max() < 0.8 * np.abs(fixed).max()


def test_passive_joints_start_at_home(tmp_path):
    # A trunk on a spring that is relaxed at home only; elsewhere it swings and shakes the tail.
    spring = '<joint type="slide" axis="1 0 0" stiffness="300" springref="0.3"/>'
    still = np.zeros(TIME.size)
    assert tail_effort(tmp_path, spring, still, "0.3 0").std() < 1.2 * EFFORT_NOISE
    assert tail_effort(tmp_path, spring, still, "0.3 0", key="other").std() > 5 * EFFORT_NOISE


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"rate": 0.0}, "rate is 0.0 Hz"),
            ({"rate": 300.0}, "rate is 300.0 Hz; .*give 1000 Hz over a whole number"),
            ({"rate": 2000.0}, "whole number of simulated steps of 0.001 s"),
            ({"substeps": 0}, "substeps is 0; it must be a whole number of at least 1"),
            ({"substeps": 1.5}, "substeps is 1.5"),
            ({"names": []}, "1 experiments have 0 names"),
        ],
    )
    def test_options(self, write, options, message):
        with pytest.raises(InputError, match=message):
            run(write(), **options)

    @pytest.mark.parametrize(
        ("targets", "message"),
        [
            (SMOOTH[:, :1], r"experiment 0 has targets of shape \(300, 1\); .*shoulder, elbow"),
            (SMOOTH[:1], r"shape \(1, 2\); give at least two rows of 2"),
            (SMOOTH[:, 0], r"shape \(300,\)"),
            (np.where(SMOOTH > 0.79, np.nan, SMOOTH), "target nan for 'shoulder' in row"),
        ],
    )
    def test_targets(self, write, targets, message):
        with pytest.raises(InputError, match=message):
            run(write(), targets)

    def test_no_experiment(self, write):
        with pytest.raises(InputError, match="0 experiments have 0 names; give at least one"):
            run_hardware(write(), [], seed=0)

    def test_files_and_places_that_are_not_there(self, write, tmp_path):
        with pytest.raises(InputError, match=r"none\.xml: the model does not load"):
            run(tmp_path / "none.xml")
        load = HiddenEffect(effect="payload", bodies=("uper",), values={"mass": 1})
        with pytest.raises(InputError, match=r"hidden in 'uper'.*did you mean 'upper'"):
            run(write(), SMOOTH, load)
        spring = HiddenEffect(effect="armature", joints=("knee",), values={"armature": 1})
        with pytest.raises(InputError, match=r"hidden in 'knee'.*it has shoulder, elbow"):
            run(write(), SMOOTH, spring)

    def test_robots_that_fly_apart(self, write):
        with pytest.raises(RuntimeError, match=r"experiment 0 went unstable .*raise substeps"):
            run(write(kp=1e5, limit="-1e9 1e9"), substeps=1)

    def test_names_the_experiment_that_went_unstable(self, write):
        # Against a spring that pushes away, only the experiment that leaves the middle is lost.
        file = write(gravity="0 0 0", joint='armature="0.01" stiffness="-60"')
        still = np.zeros((300, 2))
        with pytest.raises(RuntimeError, match="experiment 1 went unstable"):
            run_hardware(file, [still, still + 0.2 * TIME[:, None]], rate=RATE, seed=0)
