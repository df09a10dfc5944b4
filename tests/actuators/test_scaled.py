import importlib.util
import re
import subprocess
import sys
import unittest
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from dm_control.locomotion.walkers import scaled_actuators as reference
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit import actuators
from walkerkit.actuators import scaled, scaled_checks
from walkerkit.actuators.drive import drives_of_joint
from walkerkit.actuators.scaled import (
    add_effort_actuator,
    add_position_actuator,
    add_velocity_actuator,
)

XML = """
<mujoco>
  <compiler angle="radian"/>
  <default>
    <default class="strong"><general gear="2" forcerange="-3 3" dyntype="filterexact"/></default>
  </default>
  <worldbody>
    <site name="base"/>
    <body name="thigh">
      <joint name="hip" axis="0 1 0" damping="0.2"/>
      <geom size="0.05" pos="0 0 -0.2" mass="1"/>
      <body name="shin" pos="0 0 -0.4">
        <joint name="knee" axis="0 1 0" damping="0.2"/>
        <geom size="0.05" pos="0 0 -0.2" mass="1"/>
        <site name="foot" pos="0 0 -0.4"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="belt"><joint joint="hip" coef="1"/><joint joint="knee" coef="-0.5"/></fixed>
    <spatial name="cable"><site site="base"/><site site="foot"/></spatial>
  </tendon>
  <equality><joint name="coupling" joint1="hip" joint2="knee" active="false"/></equality>
</mujoco>
"""


class Servo(NamedTuple):
    ours: Any
    theirs: Any
    targets: str
    gain: str


POSITION = Servo(add_position_actuator, reference.add_position_actuator, "qposrange", "kp")
VELOCITY = Servo(add_velocity_actuator, reference.add_velocity_actuator, "qvelrange", "kv")
SERVOS = {"position": POSITION, "velocity": VELOCITY}
TARGETS = {
    "joint": ("joint", "knee"),
    "fixed tendon": ("tendon", "belt"),
    "spatial tendon": ("tendon", "cable"),
    "site": ("site", "foot"),
}
each_servo = pytest.mark.parametrize("servo", SERVOS.values(), ids=SERVOS)
quick = settings(derandomize=True, max_examples=40, deadline=None)


@pytest.fixture
def root() -> Any:
    return mjcf.from_xml_string(XML)


@pytest.fixture
def knee(root: Any) -> Any:
    return root.find("joint", "knee")


# dm_control's own tests


def run_their_tests() -> tuple[int, dict[str, str]]:
    """Runs dm_control's test case on our functions; returns the count and the failures."""
    found = importlib.util.find_spec("dm_control.locomotion.walkers.scaled_actuators_test")
    assert found is not None
    assert found.loader is not None
    # A copy of its own, so that nothing is replaced in the module that others may import.
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    assert module.scaled_actuators is reference
    module.scaled_actuators = SimpleNamespace(  # type: ignore[attr-defined]
        add_position_actuator=add_position_actuator,
        add_velocity_actuator=add_velocity_actuator,
        _GOT_INVALID_KWARGS=scaled_checks.GOT_INVALID_KWARGS,
        _GOT_INVALID_TARGET=scaled_checks.GOT_INVALID_TARGET,
    )
    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromModule(module).run(result)
    failed = [*result.failures, *result.errors]
    return result.testsRun, {test.id().rpartition(".")[2]: text for test, text in failed}


def test_dm_controls_own_tests_pass() -> None:
    count, failures = run_their_tests()
    assert failures == {}
    assert count >= 4


def test_dm_controls_own_tests_run_our_code(monkeypatch: pytest.MonkeyPatch) -> None:
    affine = scaled._affine

    def wrong(targets: Any, controls: Any, gain: float) -> tuple[float, float]:
        return affine(targets, controls, 1.001 * gain)

    monkeypatch.setattr(scaled, "_affine", wrong)
    monkeypatch.setattr(scaled_checks, "DISALLOWED_KWARGS", frozenset())
    monkeypatch.setattr(scaled_checks, "_check_target", lambda target: "joint")
    _, failures = run_their_tests()
    assert failures.keys() == {
        "test_position_actuator",
        "test_velocity_actuator",
        "test_invalid_kwargs",
        "test_invalid_target",
    }


def test_the_messages_are_dm_controls() -> None:
    assert scaled_checks.GOT_INVALID_KWARGS == reference._GOT_INVALID_KWARGS
    assert scaled_checks.GOT_INVALID_TARGET == reference._GOT_INVALID_TARGET
    assert scaled_checks.DISALLOWED_KWARGS == reference._DISALLOWED_KWARGS


# The same elements as dm_control


def bits(actuator: Any) -> list[bytes]:
    return [actuator.gainprm.tobytes(), actuator.biasprm.tobytes(), actuator.ctrlrange.tobytes()]


def rising(numbers: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Any]]:
    pairs = st.lists(numbers, min_size=2, max_size=2).map(sorted)
    return pairs.filter(lambda pair: pair[1] - pair[0] > 1e-6)


FLOATS = st.floats(-1e3, 1e3)
RANGES = st.one_of(
    rising(FLOATS),
    rising(FLOATS).map(tuple),
    rising(FLOATS).map(np.array),
    rising(FLOATS.map(np.float64)),
    rising(st.integers(-1000, 1000)),
    rising(st.integers(-1000, 1000)).map(np.array),
    rising(st.integers(-1000, 1000).map(np.int64)).map(tuple),
)
GAINS = st.one_of(
    st.floats(0, 1e4), st.integers(0, 10_000), st.floats(0, 1e4).map(np.float64), st.just(0)
)


@each_servo
@pytest.mark.parametrize("kind", ["joint", "site"])
@quick
@given(targets=RANGES, controls=RANGES, gain=GAINS)
def test_writes_the_same_model_as_dm_control(
    servo: Servo, kind: str, targets: Any, controls: Any, gain: Any
) -> None:
    kwargs: dict[str, Any] = {servo.gain: gain, "name": "servo"}
    if kind == "site":
        kwargs["refsite"] = "base"
    made = []
    for add in (servo.ours, servo.theirs):
        target = mjcf.from_xml_string(XML).find(*TARGETS[kind])
        made.append(add(target, targets, controls, **kwargs))
    assert bits(made[0]) == bits(made[1])
    assert made[0].root.to_xml_string() == made[1].root.to_xml_string()


@each_servo
@pytest.mark.parametrize("tendon", ["fixed tendon", "spatial tendon"])
@quick
@given(targets=RANGES, controls=RANGES, gain=GAINS)
def test_a_tendon_gets_what_dm_control_gives_a_joint(
    servo: Servo, tendon: str, targets: Any, controls: Any, gain: Any
) -> None:
    root = mjcf.from_xml_string(XML)
    made = servo.ours(root.find(*TARGETS[tendon]), targets, controls, **{servo.gain: gain})
    expected = servo.theirs(root.find("joint", "knee"), targets, controls, **{servo.gain: gain})
    assert bits(made) == bits(expected)
    assert made.tendon == root.find(*TARGETS[tendon])
    assert made.get_attributes().keys() - {"tendon"} == expected.get_attributes().keys() - {"joint"}


@each_servo
def test_the_defaults_are_dm_controls(servo: Servo) -> None:
    texts = []
    for add in (servo.ours, servo.theirs):
        target = mjcf.from_xml_string(XML).find("joint", "knee")
        texts.append(add(target, (-1, 2)).root.to_xml_string())
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    "attributes",
    [
        {"name": "servo", "group": 2, "user": [1, 2]},
        {"forcerange": (-5, 5), "forcelimited": True},
        {"gear": [3]},
        {"dclass": "strong"},
        {"class": "strong"},
        {"dyntype": "filter", "dynprm": [0.03], "actlimited": True, "actrange": (-1, 1)},
        {"dyntype": "FilterExact", "actearly": True},
        {"dyntype": "none", "gaintype": "fixed"},
        {"dyntype": "user", "actdim": 1},
        {"delay": 0.01, "nsample": 5, "interp": "linear"},
        {"damping": [0.1], "armature": 0.01, "lengthrange": (-1, 1)},
        {"name": None, "gaintype": None, "body": None, "refsite": None, "inheritrange": None},
    ],
)
@each_servo
def test_passes_on_what_is_legitimate(servo: Servo, attributes: dict[str, Any]) -> None:
    texts = []
    for add in (servo.ours, servo.theirs):
        target = mjcf.from_xml_string(XML).find("joint", "knee")
        texts.append(add(target, (-1, 2), **attributes).root.to_xml_string())
    assert texts[0] == texts[1]
    mujoco.MjModel.from_xml_string(texts[0])


def test_a_joint_of_an_attachment_frame_is_a_joint() -> None:
    arena, cart = mjcf.RootElement(model="arena"), mjcf.RootElement(model="cart")
    cart.worldbody.add("geom", size=[0.1])
    rail = arena.attach(cart).add("joint", type="slide", axis="1 0 0")
    made = add_position_actuator(rail, (0, 1))
    assert made.joint == rail
    model = mujoco.MjModel.from_xml_string(arena.to_xml_string())
    assert model.actuator_trntype.tolist() == [mujoco.mjtTrn.mjTRN_JOINT]


def test_defaults_still_apply_as_in_dm_control(root: Any, knee: Any) -> None:
    add_position_actuator(knee, (-1, 2), dclass="strong")
    add_position_actuator(knee, (-1, 2), dclass="strong", dyntype="none", gear=[1])
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    assert model.actuator_gear[:, 0].tolist() == [2, 1]
    assert model.actuator_forcerange.tolist() == [[-3, 3], [-3, 3]]
    assert model.actuator_dyntype.tolist() == [
        mujoco.mjtDyn.mjDYN_FILTEREXACT,
        mujoco.mjtDyn.mjDYN_NONE,
    ]


@pytest.mark.parametrize("dtype", [np.float32, np.int8, np.uint8])
def test_narrow_numbers_are_computed_in_double_precision(knee: Any, dtype: type) -> None:
    narrow: Any = np.array([0.1, 127]).astype(dtype)
    made = add_position_actuator(knee, narrow, kp=dtype(100))
    expected = reference.add_position_actuator(knee, narrow.astype(float), kp=100.0)
    assert bits(made) == bits(expected)


def test_takes_arrays_that_are_not_numpys(knee: Any) -> None:
    class Tensor:
        def tolist(self) -> list[float]:
            return [-1.0, 2.0]

    made = add_position_actuator(knee, Tensor(), kp=Fraction(1, 2))  # type: ignore[arg-type]
    assert bits(made) == bits(reference.add_position_actuator(knee, (-1.0, 2.0), kp=0.5))


# The same motion as MuJoCo's own servos


def simulate(root: Any, controls: np.ndarray) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, -0.5]
    states = []
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.actuator_force]))
    return np.array(states)


@each_servo
@pytest.mark.parametrize("kind", TARGETS)
def test_moves_like_the_native_actuator(servo: Servo, kind: str) -> None:
    attributes: dict[str, Any] = {servo.gain: {"kp": 7.3, "kv": 0.9}[servo.gain]}
    if kind == "site":
        attributes |= {"refsite": "base", "gear": [0.3, 0.1, 0.7, 0, 0, 0]}
    low, high, c_low, c_high = -0.6, 1.1, -0.8, 1.3
    # Beyond the range as well, where both have to clip.
    controls = np.random.default_rng(3).uniform(c_low - 0.3, c_high + 0.3, size=300)

    scaled_root = mjcf.from_xml_string(XML)
    servo.ours(scaled_root.find(*TARGETS[kind]), (low, high), (c_low, c_high), **attributes)
    native_root = mjcf.from_xml_string(XML)
    native = "position" if servo is POSITION else "velocity"
    attributes[TARGETS[kind][0]] = native_root.find(*TARGETS[kind])
    native_root.actuator.add(native, ctrllimited=True, ctrlrange=(low, high), **attributes)

    moved = simulate(scaled_root, controls)
    mapped = low + (controls - c_low) * (high - low) / (c_high - c_low)
    np.testing.assert_allclose(moved, simulate(native_root, mapped), rtol=1e-9, atol=1e-9)
    assert np.ptp(moved[:, -1]) > 0.1


@each_servo
@pytest.mark.parametrize("zero", [0, 0.0])
def test_zero_gain_is_a_limp_actuator(root: Any, knee: Any, servo: Servo, zero: float) -> None:
    servo.ours(knee, (-1, 2), **{servo.gain: zero})
    moved = simulate(root, np.full(20, 0.7))
    assert np.all(moved[:, -1] == 0)
    assert np.ptp(moved[:, 0]) > 1e-3


def test_without_refsite_a_site_has_a_velocity_but_no_position(root: Any) -> None:
    gear = [1, 0, 0, 0, 0, 0]
    add_position_actuator(root.find("site", "foot"), (-1, 2), kp=5, gear=gear)
    add_velocity_actuator(root.find("site", "foot"), (-1, 2), kv=5, gear=gear)
    position, velocity = simulate(root, np.full(50, 0.5))[:, -2:].T
    np.testing.assert_allclose(position, 5 * 1.25)
    assert np.ptp(velocity) > 0.1


@each_servo
@pytest.mark.parametrize("kind", ["joint", "site"])
def test_moves_bit_for_bit_as_dm_controls(servo: Servo, kind: str) -> None:
    attributes: dict[str, Any] = {servo.gain: 3.1}
    if kind == "site":
        attributes |= {"refsite": "base", "gear": [0.3, 0.1, 0.7, 0, 0, 0]}
    controls = np.random.default_rng(4).uniform(-1.2, 1.2, size=300)
    trajectories = []
    for add in (servo.ours, servo.theirs):
        root = mjcf.from_xml_string(XML)
        add(root.find(*TARGETS[kind]), (-0.6, 1.1), **attributes)
        trajectories.append(simulate(root, controls))
    assert trajectories[0].tobytes() == trajectories[1].tobytes()
    assert np.ptp(trajectories[0][:, -1]) > 0.1


# Damping of a position servo


@quick
@given(targets=RANGES, controls=RANGES, kp=GAINS, kv=GAINS)
def test_damping_changes_one_number_only(targets: Any, controls: Any, kp: Any, kv: Any) -> None:
    root = mjcf.from_xml_string(XML)
    knee = root.find("joint", "knee")
    damped = add_position_actuator(knee, targets, controls, kp, kv=kv)
    expected = reference.add_position_actuator(knee, targets, controls, kp)
    assert damped.biasprm[2] == -kv
    damped.biasprm = [*damped.biasprm[:2], 0]
    assert bits(damped) == bits(expected)


def test_damped_servo_moves_like_the_native_one() -> None:
    roots = [mjcf.from_xml_string(XML) for _ in range(2)]
    add_position_actuator(roots[0].find("joint", "knee"), (-0.6, 1.1), kp=7.3, kv=0.4, gear=[3])
    roots[1].actuator.add("position", joint="knee", kp=7.3, kv=0.4, gear=[3])
    controls = np.random.default_rng(5).uniform(-1, 1, size=300)
    moved = simulate(roots[0], controls)
    mapped = -0.6 + (controls + 1) * 0.85
    np.testing.assert_allclose(moved, simulate(roots[1], mapped), rtol=1e-9, atol=1e-9)
    undamped = mjcf.from_xml_string(XML)
    add_position_actuator(undamped.find("joint", "knee"), (-0.6, 1.1), kp=7.3, gear=[3])
    assert np.abs(moved - simulate(undamped, controls)).max() > 0.1


def test_damping_is_a_keyword(knee: Any) -> None:
    with pytest.raises(TypeError, match="takes from 2 to 4 positional arguments but 5 were given"):
        add_position_actuator(knee, (-1, 1), (-1, 1), 1.0, 2.0)  # type: ignore[call-arg]


# Efforts


@quick
@given(efforts=RANGES, controls=RANGES)
def test_efforts_span_their_range(efforts: Any, controls: Any) -> None:
    root = mjcf.from_xml_string(XML)
    add_effort_actuator(root.find("joint", "knee"), efforts, controls)
    low, middle, high = (
        Fraction(float(efforts[0])),
        (Fraction(float(efforts[0])) + Fraction(float(efforts[1]))) / 2,
        Fraction(float(efforts[1])),
    )
    beyond = float(controls[1] - controls[0])
    asked = [controls[0], (float(controls[0]) + float(controls[1])) / 2, controls[1]]
    asked += [controls[0] - beyond, controls[1] + beyond]
    forces = simulate(root, np.array(asked, float))[:, -1]
    # The bias is a difference of numbers as large as slope times control.
    size = float(max(abs(low), abs(high)))
    size += float((high - low) * Fraction(float(max(abs(asked[0]), abs(asked[2]))))) / beyond
    expected = [float(force) for force in (low, middle, high, low, high)]
    np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("kind", TARGETS)
def test_efforts_move_like_the_native_motor(kind: str) -> None:
    gear = {"gear": [0.3, 0.1, 0.7, 0, 0, 0] if kind == "site" else [2.5]}
    roots = [mjcf.from_xml_string(XML) for _ in range(2)]
    add_effort_actuator(roots[0].find(*TARGETS[kind]), (-0.5, 2), (-2, 3), **gear)
    target = {TARGETS[kind][0]: roots[1].find(*TARGETS[kind])}
    roots[1].actuator.add("motor", **target, **gear)
    controls = np.random.default_rng(6).uniform(-2, 3, size=300)
    moved = simulate(roots[0], controls)
    native = simulate(roots[1], 0.5 * controls + 0.5)
    np.testing.assert_allclose(moved, native, rtol=1e-9, atol=1e-9)


def symmetric(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, float]]:
    return numbers.map(lambda number: (-number, number))


@quick
@given(
    efforts=symmetric(st.floats(1e-3, 1e3)),
    controls=symmetric(st.floats(1e-3, 1e3)),
    target=st.floats(-1, 1),
)
def test_symmetric_efforts_are_a_plain_motor(efforts: Any, controls: Any, target: float) -> None:
    root = mjcf.from_xml_string(XML)
    made = add_effort_actuator(root.find("joint", "knee"), efforts, controls)
    assert made.biastype == "none"
    assert made.biasprm is None
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    (drive,) = drives_of_joint(model, model.joint("knee").id)
    assert drive.kind == "effort"
    assert drive.control(target * efforts[1]) == pytest.approx(target * controls[1])


def test_a_bias_from_the_defaults_does_not_reach_a_plain_motor() -> None:
    leaky = "<general biastype='affine' biasprm='1 2 3' gear='2'/>"
    root = mjcf.from_xml_string(XML.replace("<default>", f"<default>{leaky}", 1))
    add_effort_actuator(root.find("joint", "knee"), (-3, 3))
    forces = simulate(root, np.array([0.0, 0.5, -1.0]))[:, -1]
    assert forces.tolist() == [0, 1.5, -3]


def test_a_line_through_the_origin_need_not_be_symmetric(knee: Any) -> None:
    assert add_effort_actuator(knee, (-0.5, 1.5), (-1, 3)).biastype == "none"
    lifted = add_effort_actuator(knee, (0, 10))
    assert (lifted.biastype, lifted.gainprm.tolist()) == ("affine", [5])
    assert lifted.biasprm.tolist() == [5, 0, 0]


# Refusals


def refuse(
    error: type[Exception],
    message: str,
    root: Any,
    add: Any,
    target: Any,
    *args: Any,
    **kwargs: Any,
) -> None:
    before = root.to_xml_string()
    with pytest.raises(error, match=re.escape(message)) as caught:
        add(target, *args, **kwargs)
    assert type(caught.value) is error
    assert root.to_xml_string() == before
    assert root.find_all("actuator") == []


NOT_TWO_NUMBERS = "` should be two numbers (low, high), got "
BAD_RANGES = [
    ((1, 1), ValueError, "` should rise from low to high, got (1.0, 1.0): give it a width"),
    ((2, -1), ValueError, "` should rise from low to high, got (2.0, -1.0): use (-1.0, 2.0)"),
    (np.array([2, 1], np.uint8), ValueError, "` should rise from low to high, got (2.0, 1.0)"),
    ((np.nan, 1), ValueError, "[0]` should be finite, got nan: pass a finite number"),
    ([0, np.inf], ValueError, "[1]` should be finite, got inf"),
    (np.array([-np.inf, 0]), ValueError, "[0]` should be finite, got -inf"),
    ((0, 10**400), ValueError, "[1]` should be finite, got 1000"),
    ((), ValueError, NOT_TWO_NUMBERS + "0: ()"),
    ((1,), ValueError, NOT_TWO_NUMBERS + "1: (1,)"),
    ((1, 2, 3), ValueError, NOT_TWO_NUMBERS + "3: (1, 2, 3)"),
    (np.array([[1, 2]]), ValueError, NOT_TWO_NUMBERS + "1: array([[1, 2]])"),
    (np.array([[1], [2]]), TypeError, "[0]` should be a number, got [1] of type list"),
    (None, TypeError, NOT_TWO_NUMBERS + "None. PyMJCF's `joint.range` is None where a default"),
    (5, TypeError, NOT_TWO_NUMBERS + "5"),
    (np.array(5.0), TypeError, NOT_TWO_NUMBERS + "array(5.)"),
    ("12", TypeError, NOT_TWO_NUMBERS + "'12'. The one word that stands for a range is `qposrange"),
    (b"12", TypeError, NOT_TWO_NUMBERS + "b'12'"),
    ({0: 1, 1: 2}, TypeError, NOT_TWO_NUMBERS + "{0: 1, 1: 2}"),
    ({1, 2}, TypeError, NOT_TWO_NUMBERS + "{1, 2}"),
    (("1", "2"), TypeError, "[0]` should be a number, got '1' of type str: pass an int or a float"),
    ((0, None), TypeError, "[1]` should be a number, got None of type NoneType"),
    ((0, True), TypeError, "[1]` should be a number, got True of type bool"),
    (np.array([False, True]), TypeError, "[0]` should be a number, got False of type bool"),
    ((0, 1j), TypeError, "[1]` should be a number, got 1j of type complex"),
]


@pytest.mark.parametrize(("value", "error", "message"), BAD_RANGES)
def test_refuses_bad_ranges(
    root: Any, knee: Any, value: Any, error: type[Exception], message: str
) -> None:
    for servo in SERVOS.values():
        refuse(error, f"`{servo.targets}{message}", root, servo.ours, knee, value)
        refuse(error, f"`ctrlrange{message}", root, servo.ours, knee, (-1, 1), value)


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (-1, ValueError, "`{}` should not be negative, got -1: the actuator would push away"),
        (np.float32(-0.5), ValueError, "use 0.5, or 0 for no force"),
        (np.nan, ValueError, "`{}` should be finite, got nan"),
        (np.inf, ValueError, "`{}` should be finite, got inf"),
        (-np.inf, ValueError, "`{}` should be finite, got -inf"),
        (True, TypeError, "`{}` should be a number, got True of type bool: pass an int or a float"),
        (np.True_, TypeError, "`{}` should be a number, got"),
        ("3", TypeError, "`{}` should be a number, got '3' of type str"),
        (None, TypeError, "`{}` should be a number, got None of type NoneType"),
        ([1.0], TypeError, "`{}` should be a number, got [1.0] of type list"),
        (np.array([1.0]), TypeError, "`{}` should be a number, got array([1.]) of type ndarray"),
        (1j, TypeError, "`{}` should be a number, got 1j of type complex"),
    ],
)
def test_refuses_bad_gains(
    root: Any, knee: Any, value: Any, error: type[Exception], message: str
) -> None:
    for servo in SERVOS.values():
        expected = message.format(servo.gain)
        refuse(error, expected, root, servo.ours, knee, (-1, 1), **{servo.gain: value})


@pytest.mark.parametrize(
    ("positions", "controls", "kp"),
    [
        ((-3, 3), (-1, 1), 1e308),
        ((-1e308, 1e308), (-1, 1), 1.0),
        ((-(10**308), 10**308), (-1.0, 1.0), 1),
        ((0, 1), (0, 5e-324), 1.0),
        ((1e308, 1.7e308), (-2, -1), 1.0),
        ((0, 5e-324), (-1, 1), 1.0),
    ],
)
def test_refuses_what_leaves_double_precision(
    root: Any, knee: Any, positions: Any, controls: Any, kp: float
) -> None:
    message = f"a gain of {kp}, targets ({float(positions[0])}, {float(positions[1])}) and"
    refuse(ValueError, message, root, add_position_actuator, knee, positions, controls, kp)


def test_refuses_what_is_not_an_element(root: Any) -> None:
    start = "`target` should be a PyMJCF joint, tendon or site, got "
    joints = root.find("body", "thigh").joint
    for target, message in (
        (None, "None of type NoneType: look the element up, e.g. root.find('joint', 'knee')"),
        ("knee", "'knee' of type str"),
        (3, "3 of type int"),
        (joints, f"{joints!r} of type _ElementListView"),
    ):
        for servo in SERVOS.values():
            refuse(TypeError, start + message, root, servo.ours, target, (-1, 1))


def test_refuses_a_removed_element(root: Any, knee: Any) -> None:
    root.equality.joint.clear()
    root.tendon.fixed.clear()
    root.tendon.spatial.clear()
    root.find("body", "shin").remove()
    for servo in SERVOS.values():
        message = "`target` is a <joint> that was removed from its model: look up one that is still"
        refuse(ValueError, message, root, servo.ours, knee, (-1, 1))


def test_refuses_a_removed_reference_site(root: Any) -> None:
    base = root.find("site", "base")
    root.tendon.spatial.clear()
    base.remove()
    foot = root.find("site", "foot")
    message = "`refsite` is a <site> that was removed from its model"
    refuse(ValueError, message, root, add_position_actuator, foot, (-1, 1), refsite=base)


def test_refuses_other_elements_as_dm_control_does(root: Any) -> None:
    root.worldbody.add("body", name="floating").add("freejoint", name="free")
    others = [
        root,
        root.worldbody,
        root.find("body", "shin"),
        root.find_all("geom")[0],
        root.find("joint", "free"),
        root.default,
    ]
    for target in others:
        for servo in SERVOS.values():
            with pytest.raises(TypeError) as expected:
                servo.theirs(target, (-1, 1))
            refuse(TypeError, str(expected.value), root, servo.ours, target, (-1, 1))


def test_refuses_elements_that_only_refer_to_a_target(root: Any) -> None:
    for target, message in (
        (root.default.joint, "<joint> inside <default>, which is not itself a joint: pass the"),
        (root.default.site, "<site> inside <default>, which is not itself a site: pass the site"),
        (root.default.tendon, "<tendon> inside <default>, which is not itself a tendon"),
        (root.tendon, "<tendon> inside <mujoco>, which is not itself a tendon: pass the tendon"),
        (root.find("tendon", "belt").joint[0], "<joint> inside <fixed>"),
        (root.find("tendon", "cable").site[0], "<site> inside <spatial>"),
        (root.find("equality", "coupling"), "<joint> inside <equality>"),
    ):
        for servo in SERVOS.values():
            refuse(ValueError, f"`target` is the {message}", root, servo.ours, target, (-1, 1))


@each_servo
@pytest.mark.parametrize("name", sorted(reference._DISALLOWED_KWARGS))
def test_refuses_disallowed_keywords_as_dm_control_does(
    root: Any, knee: Any, servo: Servo, name: str
) -> None:
    # Before the target is looked at, and whatever the value, as there.
    for value in ("x", None):
        kwargs = {name: value, "gaintype": "affine"}
        with pytest.raises(TypeError) as expected:
            servo.theirs(None, (-1, 1), **kwargs)
        for target in (knee, None):
            refuse(TypeError, str(expected.value), root, servo.ours, target, (-1, 1), **kwargs)


@pytest.mark.parametrize(
    ("kwargs", "closest"),
    [
        ({"forcrange": (-1, 1)}, "'forcrange': did you mean one of ['forcerange', "),
        ({"dyn_type": "filter"}, "'dyn_type': did you mean one of ['dyntype'"),
        ({"class_": "strong"}, "'class_': did you mean one of ['class', 'dclass']"),
        # Neither `inheritrange` nor `gainprm`, which would be refused next.
        ({"inheritranges": 1}, "'inheritranges': did you mean one of ['lengthrange', "),
        ({"gain_prm": 1}, "'gain_prm': did you mean one of ['gaintype', "),
        ({"name": "servo", "zzz": 1}, "'zzz': use one of ['actdim', 'actearly', 'actlimited', "),
    ],
)
def test_refuses_unknown_attributes(root: Any, knee: Any, kwargs: Any, closest: str) -> None:
    message = f"<general> has no attribute {closest}"
    for servo in SERVOS.values():
        refuse(TypeError, message, root, servo.ours, knee, (-1, 1), **kwargs)


@pytest.mark.parametrize(
    ("servo", "name", "closest"),
    [(POSITION, "kpv", "kv"), (VELOCITY, "kp", "kv"), (VELOCITY, "qposrange", "qvelrange")],
)
def test_unknown_attributes_are_compared_with_the_parameters_too(
    root: Any, knee: Any, servo: Servo, name: str, closest: str
) -> None:
    message = f"<general> has no attribute '{name}': did you mean one of ['{closest}'"
    refuse(TypeError, message, root, servo.ours, knee, (-1, 1), **{name: 1})


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"gaintype": "affine"}, ValueError, "use one of ['fixed'], or add a <general> element"),
        ({"dyntype": "integrator"}, ValueError, "`dyntype='integrator'` contradicts the map from"),
        ({"dyntype": "muscle"}, ValueError, "use one of ['none', 'filter', 'filterexact', 'user']"),
        ({"dyntype": "dcmotor"}, ValueError, "`dyntype='dcmotor'` contradicts"),
        ({"dyntype": "pid"}, ValueError, "`dyntype='pid'` contradicts"),
        ({"dyntype": "nonsense"}, ValueError, "`dyntype='nonsense'` contradicts"),
        ({"jointinparent": "hip"}, TypeError, "leave `jointinparent='hip'` out: `target` alone"),
        ({"body": "shin"}, TypeError, "leave `body='shin'` out: `target` alone"),
        ({"cranklength": 0.1}, TypeError, "leave `cranklength=0.1` out: it belongs to a slider-"),
        ({"inheritrange": 1}, TypeError, "leave `inheritrange=1` out: MuJoCo ignores it on <gen"),
        ({"input": "vel"}, TypeError, "leave `input='vel'` out: it describes the inputs of a PID"),
        ({"velrange": (-1, 1)}, TypeError, "leave `velrange=(-1, 1)` out: it describes the inputs"),
        ({"ffrange": (-1, 1)}, TypeError, "leave `ffrange=(-1, 1)` out: it describes the inputs"),
        ({"refsite": "base"}, TypeError, "`refsite='base'` needs a site as `target`, which is a"),
    ],
)
def test_refuses_contradictions(
    root: Any, kwargs: Any, error: type[Exception], message: str
) -> None:
    for target in (root.find("joint", "knee"), root.find("tendon", "belt")):
        for servo in SERVOS.values():
            refuse(error, message, root, servo.ours, target, (-1, 1), name="servo", **kwargs)


def test_contradictions_of_a_site(root: Any) -> None:
    foot = root.find("site", "foot")
    message = "leave `body='shin'` out: `target` alone says what is driven"
    refuse(TypeError, message, root, add_position_actuator, foot, (0, 1), body="shin")


def test_what_pymjcf_refuses_leaves_the_model_as_it_was(root: Any, knee: Any) -> None:
    message = "attribute 'group' of element <general>: Expect an integer value: got 1.5"
    refuse(ValueError, message, root, add_position_actuator, knee, (-1, 1), name="servo", group=1.5)
    first = add_position_actuator(knee, (-1, 1), name="servo")
    with pytest.raises(ValueError, match="Duplicated identifier 'servo'"):
        add_position_actuator(knee, (-1, 1), name="servo")
    assert root.find_all("actuator") == [first]


def test_refuses_the_range_of_what_is_not_a_joint(root: Any) -> None:
    for kind, target in TARGETS.items():
        if kind != "joint":
            element = root.find(*target)
            message = f'`qposrange="joint"` needs a joint as `target`, got {element}'
            refuse(TypeError, message, root, add_position_actuator, element, "joint")


def test_only_a_position_servo_knows_the_joints_range(root: Any, knee: Any) -> None:
    for add, name in ((add_velocity_actuator, "qvelrange"), (add_effort_actuator, "effortrange")):
        message = f"`{name}{NOT_TWO_NUMBERS}'joint'. The one word that stands for a range is"
        refuse(TypeError, message, root, add, knee, "joint")


def test_refuses_bad_efforts_and_dampings(root: Any, knee: Any) -> None:
    for value, error, message in BAD_RANGES:
        refuse(error, f"`effortrange{message}", root, add_effort_actuator, knee, value)
        refuse(error, f"`ctrlrange{message}", root, add_effort_actuator, knee, (-1, 1), value)
    message = "`kv` should not be negative, got -1: the actuator would push along with the motion"
    refuse(ValueError, message, root, add_position_actuator, knee, (-1, 1), kv=-1)
    message = "`kv` should be finite, got nan"
    refuse(ValueError, message, root, add_position_actuator, knee, (-1, 1), kv=np.nan)
    for kwargs, error, message in (
        ({"kp": 1}, TypeError, "<general> has no attribute 'kp': "),
        ({"effort_range": 1}, TypeError, "did you mean one of ['effortrange'"),
        ({"biasprm": [1]}, TypeError, "Received invalid keyword argument(s): ['biasprm']"),
        ({"dyntype": "integrator"}, ValueError, "`dyntype='integrator'` contradicts the map"),
    ):
        refuse(error, message, root, add_effort_actuator, knee, (-1, 1), **kwargs)


# The package


def test_importing_the_package_does_not_load_dm_control() -> None:
    code = "import sys, walkerkit.actuators; sys.exit('dm_control' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert {"add_position_actuator", "add_velocity_actuator"} <= set(actuators.__all__)
