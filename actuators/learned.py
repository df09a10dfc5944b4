"""Actuators that a neural network stands for.

    LearnedMlpActuatorCfg(
        joint_names_expr=(".*_ankle_.*",),
        network_file="ankle.npz",
        pos_scale=1.0,
        vel_scale=0.05,
        torque_scale=10.0,
        saturation_effort=50.0,
        velocity_limit=30.0,
        effort_limit=25.0,
    )

Networks are `.npz` files of arrays: nothing in them is executed. `networks.convert_torch` and
`networks.convert_onnx` make them from other files, `networks.train_mlp_actuator` from logs of a
real joint.

A network knows the scales and the timestep of the samples that it was trained on. The scales have
no defaults, since one that is forgotten makes another drive and no error. Scales that the network's
own file has are converted with it, and are 1 here. Run it at the timestep of its samples.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.config_fields import choice, number
from walkerkit.actuators.explicit import ExplicitActuatorCfg
from walkerkit.actuators.laws.law import Law
from walkerkit.actuators.laws.learned_law import LearnedLaw
from walkerkit.actuators.networks.history import History, InputOrder
from walkerkit.actuators.networks.lstm import Lstm
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.actuators.selection import Numbers

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LearnedActuatorCfg(ExplicitActuatorCfg):
    """A network that makes effort of position errors and velocities, and the motor behind it.

    Attributes:
        network_file: the `.npz` file of the network; read when the config is made.
        pos_scale: factor on position errors [1/rad; 1/m].
        vel_scale: factor on velocities [s/rad; s/m].
        torque_scale: effort per unit of what the network puts out [N·m; N].
        input_order: `pos_vel`, position errors first, or `vel_pos`.
        saturation_effort: stall torque [N·m; N].
        velocity_limit: no-load speed [rad/s; m/s].
        effort_limit: continuous limit [N·m; N]; None for no limit.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, or its inputs and outputs are not those of this config.
    """

    network_file: str | Path
    pos_scale: float = number(per_joint=False)
    vel_scale: float = number(per_joint=False)
    torque_scale: float = number(per_joint=False)
    input_order: InputOrder = choice("pos_vel", "vel_pos", default="pos_vel")
    saturation_effort: Numbers = number(above=0)
    velocity_limit: Numbers = number(above=0)
    effort_limit: Numbers | None = number(default=None, above=0)
    network: Any = field(init=False, repr=False, compare=False, default=None)

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        network = self._load()
        object.__setattr__(self, "network", network)
        expected = (2 * self._length(), 1)
        if (network.n_inputs, network.n_outputs) != expected:
            raise ValueError(
                f"network_file={str(self.network_file)!r} has {network.n_inputs} inputs and "
                f"{network.n_outputs} outputs, the config needs {expected[0]} (a position error "
                f"and a velocity for each of history_length={self._length()} samples) and 1"
            )

    @abc.abstractmethod
    def _load(self) -> Mlp | Lstm:
        """Reads the network."""

    @abc.abstractmethod
    def _length(self) -> int:
        """Samples in a row of its inputs."""

    def law(self, numbers: Mapping[str, FloatArray]) -> Law:
        """As in `ExplicitActuatorCfg`."""
        stall = numbers["saturation_effort"]
        motor = {
            "saturation_effort": stall,
            "velocity_limit": numbers["velocity_limit"],
            "effort_limit": numbers.get("effort_limit", np.full(stall.shape, np.inf)),
        }
        history = partial(
            History,
            history_length=self._length(),
            pos_scale=self.pos_scale,
            vel_scale=self.vel_scale,
            input_order=self.input_order,
        )
        return LearnedLaw(motor, history, self.network.forward, self.torque_scale)


@dataclass(frozen=True, kw_only=True)
class LearnedMlpActuatorCfg(LearnedActuatorCfg):
    """A multilayer perceptron that sees the last few samples.

    Attributes:
        history_length: samples that it sees, the present one included: 3 is the present one and
            two before it.
    """

    history_length: int = number(default=3, at_least=1, whole=True, per_joint=False)

    def _load(self) -> Mlp:
        return Mlp.load(self.network_file)

    def _length(self) -> int:
        return self.history_length


@dataclass(frozen=True, kw_only=True)
class LstmActuatorCfg(LearnedActuatorCfg):
    """A recurrent network that sees the present sample and remembers the rest."""

    def _load(self) -> Lstm:
        return Lstm.load(self.network_file)

    def _length(self) -> int:
        return 1
