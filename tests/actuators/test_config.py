"""Configs: frozen, checked where they are written, every error with the field and its value."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest

from walkerkit.actuators import (
    ActuatorCfg,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
)

JOINTS = {"joint_names_expr": ("hip",)}
PD = {**JOINTS, "stiffness": 40.0, "damping": 2.0}
MOTOR = {**PD, "effort_limit": 25.0, "saturation_effort": 50.0, "velocity_limit": 30.0}
COMPLETE = {
    IdealPdActuatorCfg: PD,
    DcMotorActuatorCfg: MOTOR,
    BuiltinPositionActuatorCfg: PD,
    BuiltinPdActuatorCfg: PD,
    BuiltinVelocityActuatorCfg: {**JOINTS, "damping": 2.0},
    BuiltinMotorActuatorCfg: JOINTS,
    XmlPositionActuatorCfg: JOINTS,
    XmlVelocityActuatorCfg: JOINTS,
    XmlMotorActuatorCfg: JOINTS,
}
each = pytest.mark.parametrize(
    ("cls", "fields"), COMPLETE.items(), ids=[cls.__name__ for cls in COMPLETE]
)
AT_LEAST_ZERO = ("stiffness", "damping", "armature", "frictionloss", "viscous_damping")
ABOVE_ZERO = ("effort_limit", "saturation_effort", "velocity_limit")


LEAST_EFFORT = {(DcMotorActuatorCfg, "saturation_effort"): {"effort_limit": 0.25}}
"""What makes room for any value of a field that another one bounds."""


def numbers_of(cls):
    """Names of the fields that are numbers, and whether zero is allowed."""
    names = {field.name for field in dataclasses.fields(cls)}
    return {
        **{name: True for name in AT_LEAST_ZERO if name in names},
        **{name: False for name in ABOVE_ZERO if name in names},
    }


@each
def test_is_a_frozen_keyword_only_config(cls, fields):
    cfg = cls(**fields)
    assert isinstance(cfg, ActuatorCfg)
    assert cfg == cls(**fields)
    for name in ("armature", "frictionloss", "viscous_damping"):
        assert getattr(cfg, name) is None
    with pytest.raises(dataclasses.FrozenInstanceError):
        cfg.armature = 1.0
    with pytest.raises(TypeError, match="positional"):
        cls(*fields.values())
    for missing in fields:
        if missing != "effort_limit":
            with pytest.raises(TypeError, match=missing):
                cls(**{key: value for key, value in fields.items() if key != missing})


@each
def test_numbers(cls, fields):
    for name, zero in numbers_of(cls).items():
        for value in (1, 2.5, np.float32(0.5), np.int64(3), np.array(1.5), *([0] if zero else [])):
            cfg = cls(**{**fields, **LEAST_EFFORT.get((cls, name), {}), name: value})
            assert type(getattr(cfg, name)) is float
            assert getattr(cfg, name) == float(value)
        for value in (-1.0, -1e-9, -0.5, *([] if zero else [0, 0.0])):
            bound = "at least 0" if zero else "above 0"
            with pytest.raises(ValueError, match=f"^{name} should be {bound}, got {value}$"):
                cls(**{**fields, name: value})
        for value in (math.nan, math.inf, -math.inf):
            with pytest.raises(ValueError, match=f"^{name} should be finite, got {value}"):
                cls(**{**fields, name: value})
        for value in ("3", True, [1.0], np.zeros(2), object, 1j):
            with pytest.raises(TypeError, match=f"^{name} should be a number"):
                cls(**{**fields, name: value})


@each
def test_numbers_by_expression(cls, fields):
    for name in numbers_of(cls):
        given = {"hip": 1, ".*_knee": 2.5}
        fields = {**COMPLETE[cls], **LEAST_EFFORT.get((cls, name), {})}
        cfg = cls(**{**fields, name: given})
        assert getattr(cfg, name) == {"hip": 1.0, ".*_knee": 2.5}
        given["hip"] = -3.0  # the config has its own
        assert getattr(cfg, name)["hip"] == 1.0
        with pytest.raises(ValueError, match=rf"{name}\['hip'\] should be .*, got -3"):
            cls(**{**fields, name: given})
        with pytest.raises(ValueError, match=rf"{name}: '\*' is no regular expression"):
            cls(**{**fields, name: {"*": 1.0}})
        with pytest.raises(ValueError, match=f"{name} is empty"):
            cls(**{**fields, name: {}})
        with pytest.raises(TypeError, match=f"{name} should hold strings, got 3"):
            cls(**{**fields, name: {3: 1.0}})


@each
def test_expressions(cls, fields):
    def named(value):
        return cls(**{**fields, "joint_names_expr": value})

    assert named(["hip", "knee"]).joint_names_expr == ("hip", "knee")
    with pytest.raises(TypeError, match=r"joint_names_expr .*got 'hip': use \('hip',\)"):
        named("hip")
    with pytest.raises(ValueError, match=r'joint_names_expr is empty: .*use \("\.\*",\)'):
        named(())
    with pytest.raises(TypeError, match=r"joint_names_expr should be a tuple .*got None"):
        named(None)
    with pytest.raises(TypeError, match="joint_names_expr should hold strings, got 7"):
        named(("hip", 7))
    with pytest.raises(ValueError, match=r"joint_names_expr: '\*_hip' is no regular expression"):
        named(("*_hip",))


@each
def test_none_where_a_number_is_needed(cls, fields):
    for name in numbers_of(cls):
        optional = name in ("armature", "frictionloss", "viscous_damping") or (
            name == "effort_limit" and cls is not DcMotorActuatorCfg
        )
        if optional:
            assert getattr(cls(**{**fields, name: None}), name) is None
        else:
            error, text = (TypeError, f"{name} should be a number.*got None")
            if name == "effort_limit":
                error, text = ValueError, "effort_limit is missing"
            with pytest.raises(error, match=text):
                cls(**{**fields, name: None})


def test_transmission_and_gear():
    made = BuiltinMotorActuatorCfg(**JOINTS, transmission="site", gear=[0, 0, 1, 0, 0, 0])
    assert made.gear == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"transmission .*'tendon'.*got 'tendn'.*mean 'tendon'"):
        BuiltinMotorActuatorCfg(**JOINTS, transmission="tendn")
    with pytest.raises(ValueError, match=r"gear=None with transmission='site'.*six numbers"):
        BuiltinMotorActuatorCfg(**JOINTS, transmission="site")
    for wrong in ((1.0,), (0,) * 6, (math.nan,) * 6, 3.0, ("a",) * 6):
        with pytest.raises(ValueError, match="gear should be six finite numbers, not all zero"):
            BuiltinMotorActuatorCfg(**JOINTS, transmission="site", gear=wrong)
    with pytest.raises(ValueError, match=r"gear=.* with transmission='joint': only a site takes"):
        BuiltinMotorActuatorCfg(**JOINTS, gear=(1, 0, 0, 0, 0, 0))
    for name in ("armature", "frictionloss", "viscous_damping"):
        with pytest.raises(ValueError, match=f"{name}=0.0: a site has none"):
            BuiltinMotorActuatorCfg(
                **JOINTS, transmission="site", gear=(1, 0, 0, 0, 0, 0), **{name: 0.0}
            )


def test_numbers_that_are_given():
    cfg = IdealPdActuatorCfg(**PD, armature=0.0)
    assert cfg.numbers() == {"stiffness": 40.0, "damping": 2.0, "armature": 0.0}


# Limits of a motor.


@pytest.mark.parametrize(
    ("continuous", "stall", "where"),
    [
        (50.0, 25.0, "effort_limit=50 is above saturation_effort=25"),
        ({"hip": 50.0, "knee": 10.0}, 25.0, r"effort_limit\['hip'\]=50 is above"),
        (20.0, {"hip": 25.0, "knee": 15.0}, r"saturation_effort\['knee'\]=15"),
        ({"hip": 9.0, "knee": 26.0}, {"hip": 10.0, "knee": 25.0}, r"\['knee'\]=26 is above"),
    ],
)
def test_torques_of_a_motor_in_each_others_place(continuous, stall, where):
    with pytest.raises(ValueError, match=where + r".*exchange the two"):
        DcMotorActuatorCfg(**{**MOTOR, "effort_limit": continuous, "saturation_effort": stall})
    if not isinstance(continuous, dict) and not isinstance(stall, dict):
        DcMotorActuatorCfg(**{**MOTOR, "effort_limit": stall, "saturation_effort": continuous})


def test_a_motor_without_a_continuous_torque():
    motor = {key: value for key, value in MOTOR.items() if key != "effort_limit"}
    with pytest.raises(ValueError, match=r"effort_limit is missing.*effort_limit=50\.0") as caught:
        DcMotorActuatorCfg(**motor)
    assert "saturation_effort" in str(caught.value)
    assert DcMotorActuatorCfg(**motor, effort_limit=50.0).effort_limit == 50.0


# Arguments in the wrong config.


@pytest.mark.parametrize(
    ("cls", "options", "text"),
    [
        (IdealPdActuatorCfg, {"saturation_effort": 3.0}, "DcMotorActuatorCfg has it"),
        (BuiltinPositionActuatorCfg, {"velocity_limit": 3.0}, "DcMotorActuatorCfg has it"),
        (IdealPdActuatorCfg, {"effort_lookup": ()}, "RemotizedPdActuatorCfg has it"),
        (
            BuiltinPdActuatorCfg,
            {"delay_max_lag": 3},
            r"DelayedActuatorCfg\(base_cfg=BuiltinPdActuatorCfg\(\.\.\.\), delay_max_lag=",
        ),
        (IdealPdActuatorCfg, {"max_delay": 3}, r"DelayedActuatorCfg has it, as 'delay_max_lag'"),
        (IdealPdActuatorCfg, {"kp": 3.0}, "it is called 'stiffness' here"),
        (IdealPdActuatorCfg, {"friction": 3.0}, "it is called 'frictionloss' here"),
        (IdealPdActuatorCfg, {"stifness": 3.0}, r"did you mean 'stiffness'.*it has"),
    ],
)
def test_a_field_that_another_config_has(cls, options, text):
    with pytest.raises(
        TypeError, match=f"{cls.__name__} has no field {next(iter(options))!r}.*{text}"
    ):
        cls(**PD, **options)


def test_fields_of_the_base_of_a_delay():
    with pytest.raises(TypeError, match=r"DelayedActuatorCfg has no field 'stiffness'.*base_cfg"):
        DelayedActuatorCfg(stiffness=3.0)
    with pytest.raises(TypeError, match=r"DelayedActuatorCfg needs 'base_cfg'"):
        DelayedActuatorCfg(delay_max_lag=3)


def test_configs_can_be_copied():
    cfg = DelayedActuatorCfg(base_cfg=IdealPdActuatorCfg(**PD), delay_max_lag=3)
    for again in (copy.copy(cfg), copy.deepcopy(cfg), pickle.loads(pickle.dumps(cfg))):
        assert again == cfg
    assert dataclasses.replace(cfg, delay_max_lag=4).delay_max_lag == 4
