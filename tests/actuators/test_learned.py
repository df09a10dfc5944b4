"""Learned actuators: the networks' laws as actuators, against plain Python."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.actuators.contract import EXPRESSIONS, DeterministicContract
from tests.actuators.reference import dc_motor
from walkerkit.actuators import DelayedActuatorCfg, LearnedMlpActuatorCfg, LstmActuatorCfg
from walkerkit.actuators.networks.lstm import Lstm
from walkerkit.actuators.networks.mlp import Mlp

RNG = np.random.default_rng(0)
SIZES = (6, 8, 1)
WEIGHTS = [RNG.standard_normal((b, a)) for a, b in pairwise(SIZES)]
BIASES = [0.1 * RNG.standard_normal(size) for size in SIZES[1:]]
MOTOR = {"saturation_effort": 9.0, "velocity_limit": 6.0, "effort_limit": 5.0}
HIDDEN = 4
CELL = {
    "weights_ih": [RNG.standard_normal((4 * HIDDEN, 2))],
    "weights_hh": [RNG.standard_normal((4 * HIDDEN, HIDDEN))],
    "biases_ih": [0.1 * RNG.standard_normal(4 * HIDDEN)],
    "biases_hh": [0.1 * RNG.standard_normal(4 * HIDDEN)],
    "head_weight": RNG.standard_normal((1, HIDDEN)),
    "head_bias": np.array([0.05]),
}


def dot(matrix, x, bias):
    """A linear layer in plain Python."""
    return [
        sum(float(w) * value for w, value in zip(row, x, strict=True)) + float(b)
        for row, b in zip(matrix, bias, strict=True)
    ]


class Learned(DeterministicContract):
    """Remembers what the joint did, which the scalar reference has to do, too."""

    limits = (5.0, 5.0, 5.0)

    @pytest.fixture(autouse=True)
    def _remember(self, tmp_path):
        self.seen = []
        self.cfg = self.made(tmp_path / "network.npz")

    def sample(self, history, q, qd):
        if len(history) == 1:
            self.seen = []
        self.seen.append((history[-1][0] - q, qd))


class TestMlp(Learned):
    @staticmethod
    def made(path):
        Mlp(weights=WEIGHTS, biases=BIASES, activations=["tanh", "identity"]).save(path)
        return LearnedMlpActuatorCfg(
            joint_names_expr=EXPRESSIONS,
            network_file=path,
            pos_scale=2.0,
            vel_scale=0.5,
            torque_scale=6.0,
            input_order="vel_pos",
            history_length=3,
            **MOTOR,
        )

    def expected(self, j, history, q, qd):
        self.sample(history, q, qd)
        last = [self.seen[max(len(self.seen) - 1 - k, 0)] for k in range(3)]
        x = [0.5 * v for _, v in last] + [2.0 * e for e, _ in last]
        hidden = [math.tanh(value) for value in dot(WEIGHTS[0], x, BIASES[0])]
        asked = 6.0 * dot(WEIGHTS[1], hidden, BIASES[1])[0]
        return asked, dc_motor(asked, qd, 9.0, 6.0, 5.0)


class TestLstm(Learned):
    @staticmethod
    def made(path):
        Lstm(**CELL).save(path)
        return LstmActuatorCfg(
            joint_names_expr=EXPRESSIONS,
            network_file=path,
            pos_scale=3.0,
            vel_scale=0.4,
            torque_scale=12.0,
            **MOTOR,
        )

    def expected(self, j, history, q, qd):
        self.sample(history, q, qd)
        h, c = [0.0] * HIDDEN, [0.0] * HIDDEN
        for e, v in self.seen:
            x = dot(CELL["weights_ih"][0], (3.0 * e, 0.4 * v), CELL["biases_ih"][0])
            y = dot(CELL["weights_hh"][0], h, CELL["biases_hh"][0])
            gates = [a + b for a, b in zip(x, y, strict=True)]
            i, f, g, o = (gates[k * HIDDEN : (k + 1) * HIDDEN] for k in range(4))
            c = [
                sigmoid(forget) * old + sigmoid(take) * math.tanh(new)
                for forget, old, take, new in zip(f, c, i, g, strict=True)
            ]
            h = [sigmoid(out) * math.tanh(cell) for out, cell in zip(o, c, strict=True)]
        asked = 12.0 * dot(CELL["head_weight"], h, CELL["head_bias"])[0]
        return asked, dc_motor(asked, qd, 9.0, 6.0, 5.0)


class TestDelayedMlp(TestMlp):
    """The delay is in the target, and not in what the network sees of the joint."""

    @staticmethod
    def made(path):
        return DelayedActuatorCfg(base_cfg=TestMlp.made(path), delay_min_lag=3, delay_max_lag=3)

    def expected(self, j, history, q, qd):
        late = history[max(len(history) - 4, 0)]
        return super().expected(j, [*history[:-1], late], q, qd)


def sigmoid(x):
    return 1.0 / (1.0 + math.exp(-x))


@pytest.mark.parametrize("missing", ["pos_scale", "vel_scale", "torque_scale"])
def test_a_scale_that_is_forgotten_is_an_error(tmp_path, missing):
    Mlp(weights=WEIGHTS, biases=BIASES, activations=["tanh", "identity"]).save(tmp_path / "m.npz")
    scales = {"pos_scale": 1.0, "vel_scale": 1.0, "torque_scale": 1.0}
    del scales[missing]
    with pytest.raises(TypeError, match=missing):
        LearnedMlpActuatorCfg(
            joint_names_expr=EXPRESSIONS, network_file=tmp_path / "m.npz", **scales, **MOTOR
        )


def test_history_length_counts_the_present_and_two_before(tmp_path):
    Mlp(weights=WEIGHTS, biases=BIASES, activations=["tanh", "identity"]).save(tmp_path / "m.npz")
    scales = {"pos_scale": 1.0, "vel_scale": 1.0, "torque_scale": 1.0}
    cfg = LearnedMlpActuatorCfg(
        joint_names_expr=EXPRESSIONS, network_file=tmp_path / "m.npz", **scales, **MOTOR
    )
    assert cfg.history_length == 3
