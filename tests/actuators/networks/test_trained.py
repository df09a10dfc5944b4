"""What a trained network says about itself, and how it is saved."""

import numpy as np
import pytest

from walkerkit.actuators.networks import Mlp, TrainedMlp


def trained(**changes):
    return TrainedMlp(
        **{
            "mlp": Mlp(weights=[np.ones((1, 4))], biases=[np.zeros(1)], activations=["identity"]),
            "pos_scale": 4.0,
            "vel_scale": 0.5,
            "torque_scale": 7.0,
            "input_order": "vel_pos",
            "history_length": 2,
            "training_error": [3.0, 0.2, 0.1, 0.1],
            "validation_error": [3.0, 0.15, 0.12, 0.13],
            "validation_spread": 4.0,
            "best_epoch": 2,
            "stopped_early": True,
        }
        | changes
    )


def test_save_returns_the_fields_of_a_config(tmp_path):
    path = tmp_path / "ankle.npz"
    assert trained().save(path) == {
        "network_file": str(path),
        "pos_scale": 4.0,
        "vel_scale": 0.5,
        "torque_scale": 7.0,
        "input_order": "vel_pos",
        "history_length": 2,
    }
    assert Mlp.load(path).n_inputs == 4
    with pytest.raises(ValueError, match=r"saved as \.npz"):
        trained().save(tmp_path / "ankle.pt")


def test_errors_are_read_only_copies():
    errors = np.ones(4)
    result = trained(validation_error=errors)
    errors[:] = 0
    assert result.held_out_error == 1.0
    with pytest.raises(ValueError, match="read-only"):
        result.training_error[0] = 0.0


class TestVerdict:
    def test_good(self):
        text = str(trained())
        assert text.startswith(
            "Predicts the held-out effort to 0.12 (rms), 3 % of its spread of 4."
        )
        assert "epochs 4, kept 3; training error 0.1, held-out error 0.12" in text
        assert "pos_scale 4, vel_scale 0.5, torque_scale 7, history_length 2" in text
        assert "  1. " not in text

    @pytest.mark.parametrize(
        ("changes", "note"),
        [
            ({"stopped_early": False}, "raise `max_epochs`"),
            ({"validation_error": [1.0, 1.0, 0.5, 1.0]}, "5.0 times the training error"),
            ({"validation_spread": 0.2}, "Most of the effort is not explained"),
            ({"validation_spread": 0.0}, "Most of the effort is not explained"),
        ],
    )
    def test_notes(self, changes, note):
        text = str(trained(**changes))
        assert f"  1. {text.partition('  1. ')[2]}" in text
        assert note in text
        assert "  2. " not in text
