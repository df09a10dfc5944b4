"""The small network: its gradient, what it learns, and that it is the same each time."""

import numpy as np
import pytest
from scipy.optimize import check_grad

from walkerkit.actuators.networks.training_rows import TrainingRows
from walkerkit.gap.stopgap import network

HISTORY = 2


def rows(seed=0, count=1500):
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(count)
    error = 0.2 * np.sin(2.3 * time) + 0.1 * np.sin(7.1 * time + 1)
    velocity = np.gradient(error, 0.01) + 0.3 * np.cos(3.7 * time)
    effort = 5 * np.tanh(8 * error) - 0.4 * velocity * np.abs(velocity)
    effort += 0.02 * rng.standard_normal(count)
    return TrainingRows.of(
        {
            "position_error": error[:, None],
            "velocity": velocity[:, None],
            "effort": effort[:, None],
        },
        history_length=HISTORY,
        input_order="pos_vel",
        given={"pos_scale": None, "vel_scale": None, "torque_scale": None},
        validation_fraction=0.2,
    )


def test_gradient_is_that_of_finite_differences():
    rng = np.random.default_rng(0)
    weights = 0.3 * rng.standard_normal(24 * (2 * HISTORY + 2) + 1)
    x, y = rng.standard_normal((1500, 2 * HISTORY)), rng.standard_normal(1500)
    wrong = check_grad(
        lambda w: network.loss(w, x, y)[0], lambda w: network.loss(w, x, y)[1], weights
    )
    assert wrong < 1e-5


def test_a_law_beside_it_is_added_to_what_it_says():
    trained = network.fit_network(rows(), HISTORY)
    whole = network.beside(trained, stiffness=7.0, damping=0.3, constant=0.2)
    rng = np.random.default_rng(1)
    error, velocity = rng.uniform(-1, 1, (50, HISTORY)), rng.uniform(-5, 5, (50, HISTORY))
    x = np.concatenate([trained.pos_scale * error, trained.vel_scale * velocity], axis=1)
    said = trained.torque_scale * (whole.mlp(x) - trained.mlp(x))[:, 0]
    law = 7.0 * error[:, 0] - 0.3 * velocity[:, 0] + 0.2
    np.testing.assert_allclose(said, law, rtol=1e-5, atol=1e-5)


def test_what_it_adds_is_bounded():
    trained = network.fit_network(rows(), HISTORY)
    far = 1e3 * np.random.default_rng(2).standard_normal((200, 2 * HISTORY))
    said, seen = trained.mlp(far), trained.mlp(rows().training[0])
    assert np.abs(said).max() < 20 * np.abs(seen).max()


def test_learns_a_law_that_no_gains_make():
    trained = network.fit_network(rows(), HISTORY)
    assert trained.held_out_error < 0.1 * trained.validation_spread
    x, y = rows().validation
    said = trained.mlp(x) * trained.torque_scale
    error = np.sqrt(np.mean((said - y * trained.torque_scale) ** 2))
    assert error == pytest.approx(trained.held_out_error, rel=1e-9)


def test_is_the_same_each_time():
    first, second = (network.fit_network(rows(), HISTORY) for _ in range(2))
    for one, other in zip(first.mlp.weights, second.mlp.weights, strict=True):
        np.testing.assert_array_equal(one, other)
