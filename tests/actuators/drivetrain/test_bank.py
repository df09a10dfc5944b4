"""Many simulations with laws of their own, against each of them alone."""

import numpy as np
import pytest

from walkerkit.actuators.drivetrain import LAWS, IntegralAction, LawBank, Step

STEP = 1e-3
PARAMETERS = {
    "asymmetric_friction": {"forward": 0.5, "backward": 0.2},
    "stribeck_friction": {"breakaway": 0.4, "velocity": 0.3, "exponent": 1.5},
    "load_dependent_friction": {"coefficient": 0.3},
    "directional_efficiency": {"driving": 0.7, "backdriving": 1.1},
    "pose_dependent_friction": {"amplitude": 0.6, "periods": 7.0, "phase": 0.4},
    "presliding_friction": {"bristle_stiffness": 800.0},
    "setpoint_filter": {"time_constant": 0.01},
    "slew_limit": {"rate": 3.0},
    "sample_and_hold": {"period": 0.0035},
    "controller_deadband": {"width": 0.2},
    "integral_action": {"gain": 40.0, "clamp": 2.0},
    "velocity_filter": {"time_constant": 0.004},
    "torque_speed_limit": {"saturation_effort": 2.0, "velocity_limit": 5.0},
    "actuator_lag": {"time_constant": 0.006},
    "torque_ripple": {"amplitude": 0.2, "periods": 12.0, "phase": 2.0},
    "cogging": {"amplitude": 0.3, "periods": 21.0, "phase": -1.0},
    "strength_drift": {"rate": 0.4},
    "supply_sag": {"sag": 0.2},
    "supply_voltage": {"share": 0.8, "nominal": 12.0},
    "quadratic_drag": {"drag": 0.07},
    "command_delay": {"delay": 0.0042},
    "loop_delay": {"delay": 0.0025},
    "load_side_feedback": {"share": 1.0},
}
# Each simulation has one law; the last have two.
SIMULATIONS = [
    *((name,) for name in LAWS),
    ("slew_limit", "loop_delay"),
    ("integral_action", "load_dependent_friction"),
]
JOINTS = 3
WRITTEN = ("target", "effort", "extra", "friction", "target_ahead", "effort_ahead")


def motion(n_sims, n_steps=60):
    rng = np.random.default_rng(9)
    names = ("q", "qd", "target", "effort", "play", "play_speed", "held", "voltage")
    return {
        name: np.cumsum(0.3 * rng.normal(size=(n_steps, n_sims, JOINTS)), axis=0) for name in names
    }


def run(bank, series):
    """What the bank makes of the series, written field to (n_steps, n_sims, n_joints).

    As a rollout does: one step that is used again and again, with the same array for what is zero.
    """
    found = {name: [] for name in WRITTEN}
    n_steps, *shape = series["q"].shape
    constant = {"stiffness": 20.0, "damping": 0.5, "limit": 4.0, "dry": 0.1}
    zeros = np.zeros(shape)
    step = Step(
        dt=STEP,
        time=np.zeros((shape[0], 1)),
        **{name: np.full(shape, value) for name, value in constant.items()},
        **{name: values[0] for name, values in series.items()},
        extra=np.zeros(shape),
        friction=np.zeros(shape),
    )
    for k in range(n_steps):
        step.time = np.full((shape[0], 1), k * STEP)
        for name, values in series.items():
            setattr(step, name, values[k].copy())
        step.effort = np.clip(step.effort, -4.0, 4.0)
        step.target_ahead = step.effort_ahead = zeros
        step.extra.fill(0.0)
        step.friction.fill(0.0)
        for stage in ("controller", "drive", "joint"):
            bank.run(stage, step)
        for name in WRITTEN:
            found[name].append(getattr(step, name).copy())
    return {name: np.array(values) for name, values in found.items()}


def laws_of(simulations, joint=1):
    """The laws of these simulations at one joint, and nothing at the others."""
    shape = (len(simulations), JOINTS)
    found = []
    for name, law in LAWS.items():
        if any(name in own for own in simulations):
            p = {key: np.full(shape, value) for key, value in law.neutral.items()}
            for row, own in enumerate(simulations):
                if name in own:
                    for key, value in PARAMETERS[name].items():
                        p[key][row, joint] = value
            found.append((law, p))
    return LawBank(found, shape, STEP, sparse=True)


def test_every_law_is_among_the_simulations():
    assert set(PARAMETERS) == set(LAWS)


@pytest.mark.parametrize(
    ("simulations", "row"),
    [
        *((SIMULATIONS, row) for row in range(len(SIMULATIONS))),
        # Where no other law replaces what this one does, the next step begins with the same array.
        *(([(name,), ("cogging",), ("cogging",)], 0) for name in LAWS),
    ],
    ids=["+".join(s) for s in SIMULATIONS] + [f"{name} beside another" for name in LAWS],
)
def test_a_simulation_among_others_is_as_it_is_alone(simulations, row):
    series = motion(len(simulations))
    among = run(laws_of(simulations), series)
    alone = run(
        laws_of([simulations[row]]),
        {name: values[:, row : row + 1] for name, values in series.items()},
    )
    for name in WRITTEN:
        np.testing.assert_allclose(among[name][:, row], alone[name][:, 0], rtol=1e-12, atol=1e-12)


def test_a_law_that_remembers_nothing_does_the_same_in_every_step():
    """Where no other law replaces what it does, each step begins with the same array of zeros."""
    simulations = [("controller_deadband",), ("cogging",), ("cogging",)]
    # Joint 1 enters the band of its drive within each step.
    still = {name: np.zeros((3, 3, JOINTS)) for name in motion(3)}
    series = still | {"target": still["target"] + 0.2003, "qd": still["qd"] + 0.5}
    found = run(laws_of(simulations), series)
    assert found["target_ahead"][0, 0, 1] > 0.01
    for name in ("target", "target_ahead"):
        np.testing.assert_array_equal(found[name], found[name][:1].repeat(3, axis=0))


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.constant])
def test_a_law_that_is_constant_adds_the_same_to_every_step(name):
    series = motion(1)
    with_law, without = run(laws_of([(name,)]), series), run(LawBank([], (1, JOINTS), STEP), series)
    for written in WRITTEN:
        added = with_law[written] - without[written]
        if written in ("extra", "friction"):
            np.testing.assert_array_equal(added, added[:1].repeat(len(added), axis=0))
        else:
            assert not added.any()
    assert (LAWS[name].stage, LAWS[name].state) == ("joint", ())


def test_a_law_does_something_in_its_simulation_and_nothing_in_others():
    series = motion(len(SIMULATIONS))
    with_law = run(laws_of(SIMULATIONS), series)
    without = run(LawBank([], (len(SIMULATIONS), JOINTS), STEP), series)
    for row in range(len(SIMULATIONS)):
        changed = [np.abs(with_law[n][:, row] - without[n][:, row]).max(axis=0) for n in WRITTEN]
        assert max(of_joint[1] for of_joint in changed) > 1e-3
        assert max(of_joint[[0, 2]].max() for of_joint in changed) < 1e-6


def test_what_a_law_remembers_is_that_of_its_own_simulation():
    simulations = [("cogging",), ("integral_action",), ("cogging",), ("slew_limit",)]
    bank = laws_of(simulations)
    remembered = np.arange(12.0).reshape(4, JOINTS) / 10
    bank.remember(IntegralAction, {"effort": remembered})
    series = {name: values[:1] for name, values in motion(4).items()}
    made = run(bank, series)["effort"][0, 1] - np.clip(series["effort"][0, 1], -4, 4)
    error = series["target"][0, 1] - series["q"][0, 1]
    expected = remembered[1] + np.array([0, 40.0, 0]) * error * STEP
    np.testing.assert_allclose(made, expected, rtol=1e-12)
    assert remembered[1, 1] == 0.4


def test_what_is_reset_is_forgotten_and_nothing_else():
    simulations = [("cogging",), ("integral_action",), ("integral_action",), ("slew_limit",)]
    bank = laws_of(simulations)
    bank.remember(IntegralAction, {"effort": np.ones((4, JOINTS))})
    bank.reset(np.array([0, 2]))
    series = {name: np.zeros((1, 4, JOINTS)) for name in motion(4)}
    np.testing.assert_array_equal(run(bank, series)["effort"][0, :, 1], [0.0, 1.0, 0.0, 0.0])
