import copy
import dataclasses
import pickle

import numpy as np
import pytest

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect, total
from walkerkit.gap.rehearsal.hideable import HIDEABLE, NAMELESS

NAMES = ("hip", "thigh", "calf")


def effect(name="coulomb_friction", **changed):
    arguments = {"joints": ("calf",), "values": {"frictionloss": 0.6}} | changed
    return HiddenEffect(effect=name, **arguments)


# Those of the ground need feet on it; a timestep is the simulation's, not the robot's.
_NOT_HIDEABLE = {"ground_friction", "ground_compliance", "foot_offset", "timestep"}


def test_everything_that_the_workflow_names_can_be_hidden():
    assert set(CATALOGUE) - _NOT_HIDEABLE <= set(HIDEABLE)
    assert len(HIDEABLE) == 47 - len(_NOT_HIDEABLE)
    assert not set(NAMELESS) & set(CATALOGUE)


def test_spreads_own_shared_and_absent_values_over_the_model():
    own = effect(joints=("calf", "hip"), values={"hip/frictionloss": 0.1, "calf/frictionloss": 1})
    np.testing.assert_array_equal(own.spread("frictionloss", NAMES), [0.1, 0.0, 1.0])
    some = effect(joints=("calf", "hip"))
    np.testing.assert_array_equal(some.spread("frictionloss", NAMES), [0.6, 0.0, 0.6])
    np.testing.assert_array_equal(
        some.spread("frictionloss", NAMES, elsewhere=np.inf), [0.6, np.inf, 0.6]
    )
    every = effect(joints=("*",))
    np.testing.assert_array_equal(every.spread("frictionloss", NAMES), [0.6, 0.6, 0.6])
    load = HiddenEffect(effect="payload", bodies=("trunk",), values={"mass": 2.0})
    np.testing.assert_array_equal(load.spread("mass", ("world", "trunk")), [0.0, 2.0])


def test_parameters_may_differ_in_being_shared():
    spring = HiddenEffect(
        effect="parallel_spring",
        joints=("hip", "calf"),
        values={"stiffness": 2.0, "hip/springref": 0.1, "calf/springref": -1.0},
    )
    assert spring.value("stiffness", "calf") == 2.0
    assert spring.value("springref", "calf") == -1.0


@pytest.mark.parametrize(
    ("hidden", "line"),
    [
        (effect(), "coulomb_friction on calf: frictionloss 0.6 N·m"),
        (
            effect(joints=("hip", "calf"), values={"hip/frictionloss": 1, "calf/frictionloss": 2}),
            "coulomb_friction on hip, calf: frictionloss [1 (hip), 2 (calf)] N·m",
        ),
        (
            effect("command_delay", joints=("*",), values={"delay": 0.008}),
            "command_delay on all joints: delay 0.008 s",
        ),
        (
            effect("torque_constant", values={"alpha": 0.2}),
            "torque_constant on calf: alpha +0.2",
        ),
        (
            HiddenEffect(effect="base_tilt", values={"roll": -0.1, "pitch": 0.05}),
            "base_tilt: roll -0.1 rad, pitch +0.05 rad",
        ),
    ],
)
def test_describes_itself_in_one_line(hidden, line):
    assert hidden.describe() == line


def test_is_a_value():
    hidden = effect()
    assert hidden == effect()
    assert hidden != effect(values={"frictionloss": 0.5})
    for twin in (copy.deepcopy(hidden), pickle.loads(pickle.dumps(hidden))):
        assert twin == hidden
    assert dataclasses.replace(hidden, joints=("hip",)).joints == ("hip",)
    with pytest.raises(TypeError):
        hidden.values["frictionloss"] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        hidden.effect = "armature"


def test_keeps_a_copy_of_its_values():
    values = {"frictionloss": 0.6}
    hidden = effect(values=values)
    values["frictionloss"] = 5.0
    assert hidden.value("frictionloss", "calf") == 0.6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "coulomb"}, r"'coulomb' cannot be hidden.*'coulomb_friction'"),
        ({"name": "timestep"}, r"'timestep' cannot be hidden.*choose from viscous_friction, "),
        ({"joints": ()}, r"names no joints; give joints=\(name, ...\), or \(\"\*\",\) for all"),
        ({"bodies": ("calf",)}, "is an effect of the joints, not of the bodies"),
        ({"joints": ("calf", "calf")}, "give each name once"),
        ({"joints": ("*", "calf")}, "'\\*' for all joints only by itself"),
        ({"values": {}}, r"has values \[\] where it takes \['frictionloss'\]"),
        ({"values": {"damping": 1.0}}, r"\['damping'\] where it takes \['frictionloss'\]"),
        ({"values": {"frictionloss": 1.0, "hip/frictionloss": 1.0}}, "each once for all or as"),
        ({"joints": ("*",), "values": {"calf/frictionloss": 1.0}}, "where it takes"),
        ({"joints": ("hip", "calf"), "values": {"calf/frictionloss": 1.0}}, "where it takes"),
        ({"values": {"frictionloss": -0.1}}, "frictionloss = -0.1; it must be finite and >= 0 N·m"),
        ({"values": {"frictionloss": np.nan}}, "frictionloss = nan; it must be finite"),
        ({"values": {"calf/frictionloss": np.inf}}, "calf/frictionloss = inf"),
        ({"name": "torque_bias", "values": {"bias": np.inf}}, "bias = inf; it must be finite N·m"),
        ({"name": "torque_constant", "values": {"alpha": -1}}, "finite and > -1"),
        ({"name": "effort_limit", "values": {"forcerange": 0}}, "finite and > 0 N·m"),
        ({"name": "payload", "values": {"mass": 1}}, "of the bodies, not of the joints"),
        ({"name": "payload", "joints": (), "values": {"mass": 1}}, "names no bodies"),
        (
            {"name": "payload", "joints": (), "bodies": ("*",), "values": {"mass": 1}},
            "give each name once",
        ),
        ({"name": "base_tilt", "values": {"roll": 0, "pitch": 0}}, "of the world"),
        ({"name": "base_tilt", "joints": (), "values": {"roll": 0}}, r"\['pitch', 'roll'\]"),
    ],
)
def test_refuses_nonsense(arguments, message):
    with pytest.raises(InputError, match=message):
        effect(**arguments)


def test_refuses_joints_that_the_model_lacks():
    with pytest.raises(InputError, match=r"hidden in 'claf'.*did you mean 'calf'.*it has hip, "):
        effect(joints=("claf",)).spread("frictionloss", NAMES)


def test_refuses_values_that_it_lacks():
    with pytest.raises(InputError, match="no value of 'damping' for 'calf'; it has frictionloss"):
        effect().value("damping", "calf")


def test_makes_itself_stronger_and_weaker():
    limit = HiddenEffect(
        effect="torque_speed_limit",
        joints=("calf",),
        values={"saturation_effort": 3.0, "calf/velocity_limit": 6.0},
    )
    assert limit.stronger(1.5).values == {"saturation_effort": 2.0, "calf/velocity_limit": 4.0}
    wave = effect("cogging", values={"amplitude": 0.2, "periods": 12.0, "phase": 0.4})
    assert wave.stronger(0.5).values == {"amplitude": 0.1, "periods": 12.0, "phase": 0.4}
    assert wave.stronger(0.5).joints == wave.joints
    two = effect(joints=("hip", "calf"), values={"hip/frictionloss": 1, "calf/frictionloss": 2})
    assert two.stronger(3.0, ["calf"]).values == {"hip/frictionloss": 1, "calf/frictionloss": 6}


def test_adds_up_what_is_hidden_under_one_name():
    some = [
        effect(),
        effect(joints=("*",), values={"frictionloss": 1.0}),
        effect("armature", values={"armature": 5.0}),
    ]
    np.testing.assert_allclose(total(some, "coulomb_friction", "frictionloss", NAMES), [1, 1, 1.6])
    np.testing.assert_array_equal(total(some, "viscous_friction", "damping", NAMES), np.zeros(3))
