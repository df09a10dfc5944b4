"""Training: finds a planted law, on held-out time, the same way every time."""

import numpy as np
import pytest
import torch

from walkerkit.actuators.networks import History, Mlp, train_mlp_actuator


def log(n_times=1200, n_joints=2, noise=0.0):
    """A servo that lags two samples, with friction, and clips."""
    rng = np.random.default_rng(0)
    time = 0.01 * np.arange(n_times)[:, None] + np.arange(n_joints)
    error = 0.3 * np.sin(3 * time) + 0.1 * np.sin(17 * time)
    velocity = 2 * np.cos(5 * time) + 0.5 * np.sin(13 * time)
    lagged = np.vstack([error[:1], error[:1], error[:-2]])
    effort = np.clip(40 * lagged - 1.5 * velocity - np.tanh(velocity / 0.3), -10, 10)
    return error, velocity, effort + noise * rng.normal(size=effort.shape)


SHORT = {"hidden": (16,), "max_epochs": 5}
LONG = {"max_epochs": 60, "batch_size": 64, "learning_rate": 5e-3}


@pytest.fixture(scope="module")
def trained():
    return train_mlp_actuator(*log(), **LONG)


class TestPlantedLaw:
    def test_is_found(self, trained):
        assert trained.validation_spread > 3.0
        assert trained.held_out_error < 0.05 * trained.validation_spread
        assert trained.validation_error[0] > 3 * trained.held_out_error

    def test_the_lag_needs_history(self, trained):
        """The past counts: without it, the lagged error is not to be had."""
        without = train_mlp_actuator(*log(), **LONG, history_length=1)
        assert without.mlp.n_inputs == 2
        assert without.held_out_error > 2 * trained.held_out_error

    @pytest.mark.parametrize("order", ["pos_vel", "vel_pos"])
    def test_saved_network_runs_on_a_history_as_in_training(self, tmp_path, order):
        """The error that was reported is the error of the saved network, sample by sample."""
        error, velocity, effort = log(400)
        result = train_mlp_actuator(error, velocity, effort, input_order=order, **SHORT)
        fields = result.save(tmp_path / "net.npz")
        forward = Mlp.load(fields.pop("network_file")).forward((2,))
        torque_scale = fields.pop("torque_scale")
        history = History((2,), **fields)
        predicted = np.array(
            [
                torque_scale * forward(history.push(*sample))[:, 0]
                for sample in zip(error, velocity, strict=True)
            ]
        )
        held_out = slice(320 + 2, None)
        rms = np.sqrt(np.mean((predicted - effort)[held_out] ** 2))
        assert rms == pytest.approx(result.held_out_error, rel=1e-9)
        assert np.std(effort[held_out]) == pytest.approx(result.validation_spread, rel=1e-9)


class TestHeldOut:
    def test_is_the_end_of_the_log_and_not_trained_on(self):
        error, velocity, effort = log(400)
        other = effort.copy()
        other[320:] = 0.0
        first, second = (train_mlp_actuator(error, velocity, e, **SHORT) for e in (effort, other))
        np.testing.assert_array_equal(first.training_error, second.training_error)
        assert not np.array_equal(first.validation_error, second.validation_error)
        other[319] += 1.0
        third = train_mlp_actuator(error, velocity, other, **SHORT)
        assert not np.array_equal(first.training_error, third.training_error)

    def test_stops_when_it_no_longer_improves(self):
        rng = np.random.default_rng(0)
        result = train_mlp_actuator(*rng.normal(size=(3, 200, 1)), patience=4, max_epochs=200)
        assert result.stopped_early
        assert len(result.validation_error) == result.best_epoch + 1 + 4
        assert result.best_epoch == np.argmin(result.validation_error)
        assert result.held_out_error == result.validation_error.min()
        assert "Most of the effort is not explained" in str(result)

    def test_says_when_it_did_not_stop(self, trained):
        assert not trained.stopped_early
        assert len(trained.training_error) == len(trained.validation_error) == 60


class TestDeterminism:
    def bytes(self, tmp_path, **options):
        train_mlp_actuator(*log(300), **SHORT | options).save(tmp_path / "net.npz")
        return (tmp_path / "net.npz").read_bytes()

    def test_seed_decides(self, tmp_path):
        assert self.bytes(tmp_path, seed=3) == self.bytes(tmp_path, seed=3)
        assert self.bytes(tmp_path, seed=3) != self.bytes(tmp_path, seed=4)

    def test_torch_is_left_as_it_was(self, tmp_path):
        """Its threads and its generator, and they make no difference."""
        before = torch.get_num_threads()
        found = []
        try:
            for threads in (1, 2):
                torch.set_num_threads(threads)
                torch.manual_seed(threads)
                state = torch.get_rng_state()
                found.append(self.bytes(tmp_path))
                assert torch.get_num_threads() == threads
                assert torch.equal(torch.get_rng_state(), state)
        finally:
            torch.set_num_threads(before)
        assert found[0] == found[1]


class TestNetwork:
    def test_shape_and_scales_are_as_asked(self):
        scales = {"pos_scale": 2.0, "vel_scale": 0.1, "torque_scale": 15.0}
        result = train_mlp_actuator(
            *log(300), hidden=(8, 4), activation="tanh", history_length=2, max_epochs=2, **scales
        )
        assert [w.shape for w in result.mlp.weights] == [(8, 4), (4, 8), (1, 4)]
        assert result.mlp.activations == ("tanh", "tanh", "identity")
        assert {name: getattr(result, name) for name in scales} == scales

    @pytest.mark.parametrize("activation", ["elu", "relu", "sigmoid", "softsign", "identity"])
    def test_every_activation(self, activation):
        result = train_mlp_actuator(*log(300), activation=activation, **SHORT)
        assert result.mlp.activations == (activation, "identity")
        assert result.validation_error[-1] < result.validation_error[0]

    def test_no_hidden_layer_is_a_linear_law(self):
        error, velocity, _ = log(600)
        result = train_mlp_actuator(
            error, velocity, 30 * error - 2 * velocity, hidden=(), history_length=1,
            learning_rate=0.05,
        )  # fmt: skip
        (row,) = result.mlp.weights[0] * result.torque_scale
        assert row * [result.pos_scale, result.vel_scale] == pytest.approx([30, -2], rel=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden": (8, 0)}, r"`hidden\[1\]` is 0"),
        ({"hidden": (8.0,)}, r"`hidden\[0\]` is 8\.0"),
        ({"hidden": 8}, "`hidden` is 8: use a tuple"),
        ({"activation": "elo"}, "did you mean 'elu'"),
        ({"history_length": 0}, "`history_length` is 0"),
        ({"input_order": "vel"}, "`input_order` is 'vel'"),
        ({"max_epochs": 0}, "`max_epochs` is 0"),
        ({"patience": -1}, "`patience` is -1"),
        ({"batch_size": True}, "`batch_size` is True"),
        ({"learning_rate": 0.0}, r"`learning_rate` is 0\.0"),
        ({"learning_rate": float("nan")}, "`learning_rate` is nan"),
        ({"validation_fraction": 1.0}, r"`validation_fraction` is 1\.0"),
        ({"pos_scale": 0.0}, r"`pos_scale` is 0\.0"),
        ({"effort": np.zeros((300, 3))}, r"`effort` has shape \(300, 3\)"),
    ],
)
def test_wrong_argument(change, message):
    signals = dict(zip(("position_error", "velocity", "effort"), log(300), strict=True))
    with pytest.raises(ValueError, match=message):
        train_mlp_actuator(**signals | change)


def test_divergence():
    with pytest.raises(ValueError, match="lower `learning_rate`"):
        train_mlp_actuator(*log(300), activation="relu", learning_rate=1e200)
