"""Laws of controller and drive, held to definitions by hand and to themselves in finer steps."""

import numpy as np
import pytest

from walkerkit.actuators.drivetrain import (
    LAWS,
    ActuatorLag,
    ControllerDeadband,
    IntegralAction,
    LawBank,
    LoopDelay,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    Step,
    StrengthDrift,
    SupplySag,
    TorqueSpeedLimit,
    VelocityFilter,
)

STEP = 0.002


def step_of(n, dt=STEP, **given):
    arrays = ("q", "qd", "target", "effort", "extra", "friction", "dry", "held", "damping")
    values = {name: np.zeros(n) for name in arrays} | {
        "stiffness": np.full(n, 30.0),
        "limit": np.full(n, np.inf),
        "time": np.zeros(1),
    }
    arrays_given = {k: np.broadcast_to(np.asarray(v, float), (n,)) for k, v in given.items()}
    return Step(dt=dt, **(values | arrays_given))


def run(law, parameters, series, dt=STEP, start=0.0):
    """Lets a law change a step for each row of named series, (n_steps, n_joints) each."""
    n_steps, n = next(iter(series.values())).shape
    given = {name: np.broadcast_to(np.asarray(v, float), (n,)) for name, v in parameters.items()}
    bank = LawBank([(law, given)], (n,), dt)
    out = []
    for k in range(n_steps):
        step = step_of(n, dt, **{name: values[k] for name, values in series.items()})
        step.time = np.full(1, start + k * dt)
        bank.run(law.stage, step)
        out.append(step)
    return out


def targets_of(steps):
    return np.array([step.target for step in steps])


def efforts_of(steps):
    return np.array([step.effort for step in steps])


def wandering(n_steps, n=2, seed=3):
    return np.cumsum(np.random.default_rng(seed).normal(size=(n_steps, n)), axis=0)


@pytest.mark.parametrize("name", LAWS)
def test_a_neutral_law_does_nothing(name):
    law = LAWS[name]
    u, q, tau = wandering(50), wandering(50, seed=1), wandering(50, seed=2)
    ahead = {"target_ahead": wandering(50, seed=4), "effort_ahead": wandering(50, seed=5)}
    series = {"target": u, "q": q, "qd": 3 * tau, "effort": tau, "damping": 1 + 0 * tau, **ahead}
    series["limit"] = np.full_like(tau, np.abs(tau).max())
    for k, step in enumerate(run(law, law.neutral, series)):
        np.testing.assert_array_equal(step.target, u[k])
        np.testing.assert_array_equal(step.effort, tau[k])
        np.testing.assert_array_equal(step.target_ahead, ahead["target_ahead"][k])
        np.testing.assert_array_equal(step.effort_ahead, ahead["effort_ahead"][k])
        np.testing.assert_array_equal(step.extra, 0.0)
        np.testing.assert_array_equal(step.friction, 0.0)


@pytest.mark.parametrize(
    ("law", "parameters", "signal"),
    [
        (SetpointFilter, {"time_constant": [0.004, 0.05]}, "target"),
        (SampleAndHold, {"period": [0.0053, 0.0124]}, "target"),
        (SampleAndHold, {"period": [0.0007, 0.01]}, "target"),
        (ActuatorLag, {"time_constant": [0.001, 0.03]}, "effort"),
        (VelocityFilter, {"time_constant": [0.003, 0.02]}, "effort"),
    ],
)
def test_a_step_has_the_mean_of_finer_ones(law, parameters, signal):
    parts = 20
    coarse = {"target": wandering(60), "effort": wandering(60, seed=5), "qd": wandering(60, seed=6)}
    coarse["damping"] = 1 + 0 * coarse["qd"]
    fine = {name: np.repeat(values, parts, axis=0) for name, values in coarse.items()}
    got = np.array([getattr(step, signal) for step in run(law, parameters, coarse)])
    finer = np.array([getattr(step, signal) for step in run(law, parameters, fine, STEP / parts)])
    expected = finer.reshape(60, parts, 2).mean(axis=1)
    assert np.abs(expected - coarse[signal]).max() > 0.1
    np.testing.assert_allclose(got, expected, atol=1e-9)


def test_a_filter_reaches_63_per_cent_of_a_step_in_its_time_constant():
    u = np.ones((400, 1))
    u[0] = 0.0
    got = targets_of(run(SetpointFilter, {"time_constant": 0.02}, {"target": u}, dt=1e-4))
    assert got[201, 0] == pytest.approx(1 - np.exp(-1), abs=2e-3)


def test_sample_and_hold_takes_up_what_there_is_at_multiples_of_its_period():
    u = wandering(40)
    got = targets_of(run(SampleAndHold, {"period": [0.008, 0.02]}, {"target": u}, start=0.012))
    for k in range(40):
        time = 6 + k  # in steps
        for joint, period in enumerate((4, 10)):
            last = max(time // period * period - 6, 0)
            assert got[k, joint] == u[last, joint]


def test_slew_limit_goes_as_fast_as_it_may():
    u = wandering(100)
    got = targets_of(run(SlewLimit, {"rate": [50.0, 300.0]}, {"target": u}))
    where = u[0].copy()
    for k in range(100):
        for joint, rate in enumerate((50.0, 300.0)):
            where[joint] += max(-rate * STEP, min(rate * STEP, u[k, joint] - where[joint]))
        np.testing.assert_allclose(got[k], where, atol=1e-12)


@pytest.mark.parametrize("qd", [0.0, 4.0, -4.0, 60.0])
def test_deadband_counts_the_part_of_a_step_within_it(qd):
    q = np.linspace(-0.1, 0.1, 81)[None]
    (step,) = run(ControllerDeadband, {"width": 0.03}, {"q": q, "qd": qd + 0 * q})
    turns = STEP * (np.arange(20000) + 0.5) / 20000
    errors = -q[0][:, None] - qd * turns
    outside = 1 - np.mean(np.abs(errors) < 0.03, axis=1)
    clear = np.abs(np.abs(q[0]) - 0.03) > 1e-9  # at rest on the edge it may be either
    np.testing.assert_allclose((step.target - 0.0)[clear], (q[0] * (1 - outside))[clear], atol=1e-5)


def test_loop_delay_is_the_effort_of_then():
    tau = wandering(80, n=3)
    delays = np.array([0.0, 0.0071, 0.02])
    got = efforts_of(run(LoopDelay, {"delay": delays}, {"effort": tau}))
    time = STEP * np.arange(80)
    for joint, delay in enumerate(delays):
        expected = np.interp(time - delay, time, tau[:, joint])
        np.testing.assert_allclose(got[:, joint], expected, atol=1e-9)


def test_loop_delay_forgets_the_rows_that_are_reset():
    bank = LawBank([(LoopDelay, {"delay": np.full((2, 1), 0.01)})], (2, 1), STEP)
    for again in (False, True):
        if again:
            bank.reset(np.array([1]))
        for k in range(20):
            step = step_of(2)
            step.effort = np.full((2, 1), 1.0 + k)
            step.stiffness = step.target = np.zeros((2, 1))
            bank.run("drive", step)
            late = max(k - 5, 0)
            # The row that was not reset still has the end of the first round in it.
            kept = 20 - 5 + k if again and k < 5 else late
            np.testing.assert_array_equal(step.effort[:, 0], [1.0 + kept, 1.0 + late])


def test_integral_action_winds_up_to_its_clamp_and_to_the_drive_s_limit():
    error = np.concatenate([np.full(200, 0.5), np.full(300, -0.4)])[:, None] * np.ones(3)
    limit = np.array([np.inf, np.inf, 1.5]) * np.ones_like(error)
    series = {"target": error, "limit": limit, "effort": 0.1 + 0 * error}
    got = efforts_of(run(IntegralAction, {"gain": 12.0, "clamp": [1e9, 1.0, 1e9]}, series))
    added = np.zeros(3)
    for k in range(500):
        for joint, most in enumerate((1e9, 1.0, 1.5)):
            added[joint] += 12.0 * error[k, joint] * STEP
            added[joint] = max(-most, min(most, added[joint]))
        expected = np.clip(added + 0.1, [-np.inf, -np.inf, -1.5], [np.inf, np.inf, 1.5])
        np.testing.assert_allclose(got[k], expected, atol=1e-12)
    assert np.abs(got[:, 0]).max() > 2.0


def test_velocity_filter_leaves_a_steady_velocity_its_damping():
    qd = np.full((2000, 1), 3.0)
    series = {"qd": qd, "damping": 0.8 + 0 * qd, "effort": -0.8 * qd}
    got = efforts_of(run(VelocityFilter, {"time_constant": 0.02}, series))
    np.testing.assert_allclose(got, -2.4, atol=1e-12)
    series["qd"] = np.sin(2 * np.pi * 40 * STEP * np.arange(2000))[:, None]
    series["effort"] = -0.8 * series["qd"]
    weak = efforts_of(run(VelocityFilter, {"time_constant": 0.02}, series))[1000:]
    assert np.ptp(weak) == pytest.approx(1.6 / np.hypot(1, 2 * np.pi * 40 * 0.02), rel=0.05)


# S, V and (τ, q̇) → what is left of τ.
LINE = [
    (30, 10, 30),
    (90, 10, 80),
    (90, 40, 20),
    (90, 60, -20),
    (-90, 10, -90),
    (-200, 10, -100),
    (-30, -40, -20),
]


@pytest.mark.parametrize(("effort", "qd", "left"), LINE)
def test_torque_speed_limit_is_a_line_between_stall_and_idling(effort, qd, left):
    series = {"effort": np.array([[effort, -effort]]), "qd": np.array([[qd, -qd]])}
    (step,) = run(TorqueSpeedLimit, {"saturation_effort": 100.0, "velocity_limit": 50.0}, series)
    np.testing.assert_allclose(step.effort, [left, -left], atol=1e-9)


def test_supply_sag_takes_from_all_what_all_draw():
    series = {
        "effort": np.array([[9.0, -9.0, 2.0]]),
        "qd": np.array([[2.0, -3.0, 0.0]]),
        "limit": np.array([[10.0, 8.0, np.inf]]),
    }
    (step,) = run(SupplySag, {"sag": [0.01, 0.01, 0.01]}, series)
    np.testing.assert_allclose(step.effort, [10 * 0.55, -8 * 0.55, 2.0])


def test_strength_drifts_behind_what_the_drive_reports():
    effort = np.full((3, 1), 2.0)
    steps = run(StrengthDrift, {"rate": 0.05}, {"effort": effort}, dt=10.0)
    np.testing.assert_array_equal(efforts_of(steps), effort)
    np.testing.assert_allclose([step.extra[0] for step in steps], [0.0, -1.0, -2.0])
