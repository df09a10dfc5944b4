import math
import re
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit.actuators.motors import (
    MOTORS,
    ElectricActuator,
    Gains,
    Motor,
    gains_from_bandwidth,
    linkage_matrix,
    parallel_linkage,
    reflected_inertia,
    reflected_inertia_from_two_stage_planetary,
    rotary_to_linear,
    rpm_to_rad,
)

quick = settings(derandomize=True, max_examples=50, deadline=None)
SIZES = st.floats(1e-3, 1e3)
ONE_STAGE = (0.489e-4, 0.098e-4, 0.533e-4)
GEARS = (1, 4.5, 1 + 48 / 22)


def actuators(stalls: bool = True) -> st.SearchStrategy[ElectricActuator]:
    return st.builds(
        lambda inertia, velocity, effort, ratio: ElectricActuator(
            reflected_inertia=inertia,
            velocity_limit=velocity,
            effort_limit=effort,
            saturation_effort=effort * ratio if stalls else None,
        ),
        SIZES,
        SIZES,
        SIZES,
        st.floats(1, 5),
    )


def refuses(error: type[Exception], message: str, call: Any, *args: Any, **kwargs: Any) -> None:
    with pytest.raises(error, match=re.escape(message)):
        call(*args, **kwargs)


# Gears


def test_the_documented_gearbox() -> None:
    inertia = reflected_inertia_from_two_stage_planetary(ONE_STAGE, GEARS)
    assert inertia == pytest.approx(0.0101775200413, rel=0, abs=1e-13)
    stiffness, damping = gains_from_bandwidth(inertia, 10 * 2 * math.pi, 2.0)
    assert stiffness == pytest.approx(40.17923864, rel=0, abs=1e-8)
    assert damping == pytest.approx(2.557889775, rel=0, abs=1e-9)


@quick
@given(
    inertias=st.tuples(SIZES, SIZES, SIZES),
    stages=st.tuples(st.floats(0.1, 100), st.floats(0.1, 100)),
    speed=st.floats(0.1, 10),
)
def test_the_kinetic_energy_is_that_of_the_three_shafts(
    inertias: tuple[float, ...], stages: tuple[float, float], speed: float
) -> None:
    at_joint = reflected_inertia_from_two_stage_planetary(inertias, (1, *stages))
    speeds = (speed * stages[1] * stages[0], speed * stages[1], speed)
    energy = sum(0.5 * j * w * w for j, w in zip(inertias, speeds, strict=True))
    assert 0.5 * at_joint * speed * speed == pytest.approx(energy)


@quick
@given(rotor=SIZES, ratio=SIZES, second=SIZES)
def test_a_bare_rotor_is_the_special_case(rotor: float, ratio: float, second: float) -> None:
    single = reflected_inertia(rotor, ratio * second)
    two = reflected_inertia_from_two_stage_planetary((rotor, 0, 0), (1, ratio, second))
    assert two == pytest.approx(single)
    assert reflected_inertia(reflected_inertia(rotor, ratio), second) == pytest.approx(single)
    assert reflected_inertia(rotor, 1) == rotor


def test_takes_arrays() -> None:
    inertia = reflected_inertia_from_two_stage_planetary(np.array(ONE_STAGE), np.array(GEARS))
    assert inertia == reflected_inertia_from_two_stage_planetary(ONE_STAGE, GEARS)
    assert type(inertia) is float


@quick
@given(rpm=st.floats(-1e5, 1e5))
def test_revolutions_per_minute(rpm: float) -> None:
    assert rpm_to_rad(60) == pytest.approx(2 * math.pi)
    assert rpm_to_rad(rpm) == pytest.approx(math.radians(rpm * 360) / 60)


@pytest.mark.parametrize(
    ("inertias", "ratios", "error", "message"),
    [
        (ONE_STAGE, (4.5, 3.2, 1), ValueError, "`gear_ratio[0]` should be 1, got 4.5: the first"),
        (ONE_STAGE, (4.5, 3.2, 1), ValueError, "or (1, 4.5, 3.2) if the list began with the first"),
        (ONE_STAGE, (1, 4.5), ValueError, "`gear_ratio` should be three numbers, got 2: (1, 4.5)"),
        (ONE_STAGE[:1], GEARS, ValueError, "`rotor_inertia` should be three numbers, got 1"),
        (1e-4, GEARS, TypeError, "`rotor_inertia` should be three numbers, got 0.0001"),
        (ONE_STAGE, "123", TypeError, "`gear_ratio` should be three numbers, got '123'"),
        (
            (1e-4, -1e-5, 0),
            GEARS,
            ValueError,
            "`rotor_inertia[1]` should be at least 0, got -1e-05",
        ),
        (ONE_STAGE, (1, 0, 3), ValueError, "`gear_ratio[1]` should be above 0, got 0"),
        (ONE_STAGE, (1, 2, math.nan), ValueError, "`gear_ratio[2]` should be finite, got nan"),
        (ONE_STAGE, (1, 2, "3"), TypeError, "`gear_ratio[2]` should be a number, got '3'"),
        (ONE_STAGE, (True, 2, 3), TypeError, "`gear_ratio[0]` should be a number, got True"),
    ],
)
def test_refuses_bad_gearboxes(
    inertias: Any, ratios: Any, error: type[Exception], message: str
) -> None:
    refuses(error, message, reflected_inertia_from_two_stage_planetary, inertias, ratios)


def test_refuses_bad_single_stages_and_speeds() -> None:
    refuses(ValueError, "`rotor_inertia` should be at least 0", reflected_inertia, -1e-4, 6)
    refuses(ValueError, "`gear_ratio` should be above 0, got 0", reflected_inertia, 1e-4, 0)
    refuses(TypeError, "`gear_ratio` should be a number", reflected_inertia, 1e-4, "6:1")
    refuses(ValueError, "`rpm` should be finite, got inf", rpm_to_rad, math.inf)


# Rotary to linear


@quick
@given(motor=actuators(), travel=st.floats(1e-3, 1), share=st.floats(0.05, 1))
def test_a_rack_conserves_energy_and_power(
    motor: ElectricActuator, travel: float, share: float
) -> None:
    linear = rotary_to_linear(motor, pinion_radius=travel, efficiency=share)
    speed = motor.velocity_limit
    assert linear.velocity_limit == pytest.approx(speed * travel)
    assert linear.reflected_inertia * linear.velocity_limit**2 == pytest.approx(
        motor.reflected_inertia * speed**2
    )
    power = motor.effort_limit * speed
    assert linear.effort_limit * linear.velocity_limit == pytest.approx(share * power)
    assert motor.saturation_effort is not None
    assert linear.saturation_effort == pytest.approx(share * motor.saturation_effort / travel)


@quick
@given(motor=actuators(stalls=False), lead=st.floats(1e-3, 1))
def test_a_screw_travels_its_lead_per_turn(motor: ElectricActuator, lead: float) -> None:
    linear = rotary_to_linear(motor, lead=lead)
    turns_per_second = motor.velocity_limit / (2 * math.pi)
    assert linear.velocity_limit == pytest.approx(turns_per_second * lead)
    assert linear.effort_limit * lead == pytest.approx(motor.effort_limit * 2 * math.pi)
    assert linear.saturation_effort is None


def test_refuses_bad_screws() -> None:
    motor = MOTORS["unitree_5020"].actuator()
    both = "give one of `lead` [m/rev] and `pinion_radius` [m], got lead="
    refuses(TypeError, f"{both}None and pinion_radius=None", rotary_to_linear, motor)
    refuses(TypeError, f"{both}0.01", rotary_to_linear, motor, lead=0.01, pinion_radius=0.1)
    refuses(ValueError, "`lead` should be above 0, got 0", rotary_to_linear, motor, lead=0)
    refuses(ValueError, "`pinion_radius` should be", rotary_to_linear, motor, pinion_radius=-1)
    refuses(
        ValueError,
        "`efficiency` should be at most 1, got 80",
        rotary_to_linear,
        motor,
        lead=0.01,
        efficiency=80,
    )


# Gains


@quick
@given(inertia=SIZES, frequency=st.floats(0.1, 1e3), ratio=st.floats(0, 0.9))
def test_the_inertia_swings_as_asked(inertia: float, frequency: float, ratio: float) -> None:
    gains = gains_from_bandwidth(inertia, frequency, ratio)
    assert isinstance(gains, Gains)
    poles = np.roots([inertia, gains.damping, gains.stiffness])
    np.testing.assert_allclose(np.abs(poles), frequency, rtol=1e-9)
    np.testing.assert_allclose(poles.real, -ratio * frequency, rtol=1e-7, atol=1e-9 * frequency)


def test_refuses_bad_bandwidths() -> None:
    refuses(ValueError, "`inertia` should be above 0, got 0", gains_from_bandwidth, 0, 60, 1)
    refuses(ValueError, "`natural_frequency` should be above 0", gains_from_bandwidth, 0.01, -60, 1)
    refuses(
        ValueError, "`damping_ratio` should be at least 0", gains_from_bandwidth, 0.01, 60, -0.1
    )
    refuses(TypeError, "`inertia` should be a number", gains_from_bandwidth, None, 60, 1)


# Electric actuators


@pytest.mark.parametrize(
    ("field", "value", "error", "message"),
    [
        ("reflected_inertia", -1e-3, ValueError, "`reflected_inertia` should be at least 0"),
        ("velocity_limit", 0, ValueError, "`velocity_limit` should be above 0, got 0"),
        ("effort_limit", 0.0, ValueError, "`effort_limit` should be above 0, got 0.0"),
        ("effort_limit", math.inf, ValueError, "`effort_limit` should be finite, got inf"),
        ("effort_limit", "88", TypeError, "`effort_limit` should be a number, got '88'"),
        ("saturation_effort", 87, ValueError, "at least the effort_limit of 88, got 87: a motor"),
        ("saturation_effort", math.nan, ValueError, "`saturation_effort` should be finite"),
    ],
)
def test_refuses_bad_actuators(
    field: str, value: Any, error: type[Exception], message: str
) -> None:
    good: dict[str, Any] = {"reflected_inertia": 0.01, "velocity_limit": 32, "effort_limit": 88}
    assert ElectricActuator(**good).saturation_effort is None
    refuses(error, message, ElectricActuator, **good | {field: value})


# Linkages


@quick
@given(motors=st.lists(actuators(), min_size=1, max_size=4))
def test_side_by_side_the_motors_add_up(motors: list[ElectricActuator]) -> None:
    (joint,) = parallel_linkage(motors)
    assert joint.reflected_inertia == pytest.approx(sum(m.reflected_inertia for m in motors))
    assert joint.effort_limit == pytest.approx(sum(m.effort_limit for m in motors))
    assert joint.velocity_limit == min(m.velocity_limit for m in motors)
    assert joint.saturation_effort == pytest.approx(sum(m.saturation_effort or 0 for m in motors))


def test_a_stall_torque_that_one_motor_hides_is_hidden() -> None:
    known = ElectricActuator(
        reflected_inertia=0, velocity_limit=1, effort_limit=1, saturation_effort=2
    )
    unknown = ElectricActuator(reflected_inertia=0, velocity_limit=1, effort_limit=1)
    assert parallel_linkage([known, unknown])[0].saturation_effort is None
    # Where it does not drive the joint, it hides nothing.
    assert parallel_linkage([known, unknown], [[1], [0]])[0].saturation_effort == 2


def test_the_documented_ankle() -> None:
    motor = MOTORS["unitree_5020"].actuator()
    gains = gains_from_bandwidth(motor.reflected_inertia, 10 * 2 * math.pi, 2.0)
    differential = [[1, 1], [1, -1]]
    for joint in parallel_linkage([motor, motor], differential):
        assert joint.effort_limit == 50
        assert joint.reflected_inertia == pytest.approx(2 * motor.reflected_inertia)
        assert joint.velocity_limit == 37
    for value in gains:
        assert linkage_matrix(value, differential).tolist() == [[2 * value, 0], [0, 2 * value]]


JACOBIANS = st.integers(1, 3).flatmap(
    lambda joints: st.lists(
        st.lists(st.floats(0.1, 3), min_size=joints, max_size=joints), min_size=joints, max_size=4
    )
)


@quick
@given(jacobian=JACOBIANS, data=st.data())
def test_a_linkage_conserves_energy(jacobian: Any, data: st.DataObject) -> None:
    n_motors, n_joints = np.shape(jacobian)
    motors = data.draw(st.lists(actuators(), min_size=n_motors, max_size=n_motors))
    speeds = np.array(data.draw(st.lists(st.floats(-5, 5), min_size=n_joints, max_size=n_joints)))
    inertias = [motor.reflected_inertia for motor in motors]
    matrix = linkage_matrix(inertias, jacobian)
    energy = sum(
        0.5 * motor.reflected_inertia * sum(j * w for j, w in zip(row, speeds, strict=True)) ** 2
        for motor, row in zip(motors, jacobian, strict=True)
    )
    assert 0.5 * speeds @ matrix @ speeds == pytest.approx(energy)
    joints = parallel_linkage(motors, jacobian)
    np.testing.assert_allclose([joint.reflected_inertia for joint in joints], np.diag(matrix))
    for index, joint in enumerate(joints):
        column = np.array(jacobian)[:, index]
        # At the limits of the joint no motor is beyond its own, and one is at it.
        shares = joint.velocity_limit * column / [motor.velocity_limit for motor in motors]
        assert np.abs(shares).max() == pytest.approx(1)
        torques = np.sign(column) * [motor.effort_limit for motor in motors]
        assert joint.effort_limit == pytest.approx(column @ torques)


def test_the_inertia_is_that_of_mujocos_tendons() -> None:
    jacobian, inertias = [[0.8, 1.3], [1.1, -0.6], [0.0, 2.0]], [0.01, 0.03, 0.002]
    tendons = "".join(
        f'<fixed armature="{inertia}"><joint joint="pitch" coef="{row[0]}"/>'
        f'<joint joint="roll" coef="{row[1]}"/></fixed>'
        for inertia, row in zip(inertias, jacobian, strict=True)
    )
    xml = """
    <mujoco>
      <option gravity="0 0 0"/>
      <worldbody>
        <body><joint name="pitch" axis="0 1 0"/><geom size="0.1" mass="1"/>
          <body><joint name="roll" axis="1 0 0"/><geom size="0.1" mass="1"/></body>
        </body>
      </worldbody>
      <tendon>{}</tendon>
    </mujoco>
    """
    matrices = []
    for text in (tendons, tendons.replace("armature", "stiffness")):
        model = mujoco.MjModel.from_xml_string(xml.format(text))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        full = np.zeros((2, 2))
        mujoco.mj_fullM(model, data, full)
        matrices.append(full)
    np.testing.assert_allclose(
        matrices[0] - matrices[1], linkage_matrix(inertias, jacobian), rtol=1e-12
    )


def test_refuses_bad_linkages() -> None:
    motor = MOTORS["unitree_5020"].actuator()
    refuses(ValueError, "`actuators` is empty", parallel_linkage, [])
    message = "`actuators[1]` should be an ElectricActuator, got Motor(name='unitree_5020'"
    refuses(TypeError, message, parallel_linkage, [motor, MOTORS["unitree_5020"]])
    message = "`jacobian` should have a row for each of the 2 motors, got shape (1, 2)"
    refuses(ValueError, message, parallel_linkage, [motor, motor], [[1, 1]])
    message = "`jacobian` should have shape (n_motors, n_joints), got (2,)"
    refuses(ValueError, message, parallel_linkage, [motor, motor], [1, 1])
    message = "column 1 of `jacobian` is zero: no motor drives that joint"
    refuses(ValueError, message, parallel_linkage, [motor, motor], [[1, 0], [1, 0]])
    message = "`jacobian` should be finite, got [[nan]]"
    refuses(ValueError, message, parallel_linkage, [motor], [[math.nan]])
    message = "`values` should be one number for each of the 2 motors (rows of `jacobian`), got"
    refuses(ValueError, message, linkage_matrix, [1, 2, 3], [[1, 1], [1, -1]])


# The table

# Rotor inertias in 1e-7 kg·m² and gears as published, and the armature that HybridRobotics'
# whole_body_tracking states for the same motors.
REFERENCE_MOTORS = {
    "unitree_5020": ((139, 17, 169), (1 + Fraction(46, 18), 1 + Fraction(56, 16)), 0.003609725),
    "unitree_7520_14": ((489, 98, 533), (Fraction(9, 2), 1 + Fraction(48, 22)), 0.010177520),
    "unitree_7520_22": ((489, 109, 738), (Fraction(9, 2), Fraction(5)), 0.025101925),
    "unitree_4010": ((68, 0, 0), (Fraction(5), Fraction(5)), 0.00425),
}


@pytest.mark.parametrize("name", REFERENCE_MOTORS)
def test_the_four_reference_motors(name: str) -> None:
    (first, second, third), (stage_1, stage_2), published = REFERENCE_MOTORS[name]
    exact = (first * (stage_1 * stage_2) ** 2 + second * stage_2**2 + third) / 10**7
    inertia = MOTORS[name].actuator().reflected_inertia
    assert inertia == pytest.approx(float(exact), rel=1e-14)
    assert inertia == pytest.approx(published, rel=0, abs=1e-9)


def test_the_limits_are_as_published() -> None:
    limits = {name: (m.velocity_limit, m.effort_limit) for name, m in MOTORS.items()}
    assert limits == {
        "unitree_5020": (37, 25),
        "unitree_7520_14": (32, 88),
        "unitree_7520_22": (20, 139),
        "unitree_4010": (22, 5),
        "unitree_go1_hip": (30.1, 23.7),
        "unitree_go1_knee": (20.06, 35.55),
        "anydrive_3": (7.5, 80),
        "dynamixel_xl330_m288": (103 * 2 * math.pi / 60, 0.52),
        "dynamixel_xm430_w350": (46 * 2 * math.pi / 60, 4.1),
    }
    assert MOTORS["anydrive_3"].saturation_effort == 120


def test_the_knee_of_the_go1_is_its_hip_geared_down_once_more() -> None:
    hip, knee = (MOTORS[f"unitree_go1_{name}"].actuator() for name in ("hip", "knee"))
    assert hip.reflected_inertia == pytest.approx(0.000111842 * 36)
    assert knee.reflected_inertia == pytest.approx(1.5**2 * hip.reflected_inertia)
    assert knee.effort_limit == pytest.approx(1.5 * hip.effort_limit)
    assert knee.velocity_limit == pytest.approx(hip.velocity_limit / 1.5, rel=1e-3)


@pytest.mark.parametrize("name", MOTORS)
def test_every_motor_names_itself_and_its_source(name: str) -> None:
    motor = MOTORS[name]
    assert motor.name == name
    assert re.match(r"(github\.com|emanual\.robotis\.com)/\S+", motor.source)
    given = motor.actuator(reflected_inertia=0.5)
    assert given.reflected_inertia == 0.5
    assert given.effort_limit == motor.effort_limit
    if motor.reflected_inertia is None:
        message = f"no rotor inertia is published for '{name}': measure it, for instance by"
        refuses(ValueError, message, motor.actuator)
    else:
        assert motor.actuator().reflected_inertia == motor.reflected_inertia


def test_the_table_is_read_only_and_helps_to_find_a_name() -> None:
    with pytest.raises(TypeError):
        MOTORS["mine"] = MOTORS["anydrive_3"]  # type: ignore[index]
    with pytest.raises(KeyError, match=r"no motor is called 'g1': use one of \['anydrive_3', "):
        MOTORS["g1"]
    assert "g1" not in MOTORS
    assert MOTORS.get("g1") is None


def test_refuses_bad_motors() -> None:
    good: dict[str, Any] = {"name": "mine", "source": "me", "velocity_limit": 1, "effort_limit": 1}
    assert Motor(**good).reflected_inertia is None
    assert Motor(**good, rotor_inertia=(2,), gear_ratio=(3,)).reflected_inertia == 18
    for wrong, message in (
        ({"effort_limit": 0}, "`effort_limit` should be above 0, got 0"),
        ({"rotor_inertia": (1,)}, "'mine' has a `rotor_inertia` and no `gear_ratio`: give both"),
        ({"rotor_inertia": (1, 1), "gear_ratio": (1, 2)}, "`rotor_inertia` should be three numb"),
        ({"rotor_inertia": (1, 1, 1), "gear_ratio": (9,)}, "`gear_ratio` should be three numbers"),
        ({"rotor_inertia": (-1,), "gear_ratio": (9,)}, "`rotor_inertia` should be at least 0"),
    ):
        refuses(ValueError, message, Motor, **good | wrong)
