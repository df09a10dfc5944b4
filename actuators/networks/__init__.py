"""Learned actuator networks in numpy: run every substep, saved as plain arrays.

    mlp = Mlp.load("ankle.npz")
    history = History((12,), history_length=3, pos_scale=1.0, vel_scale=0.05)
    forward = mlp.forward((12,))
    effort = 10.0 * forward(history.push(position_error, velocity))[:, 0]

`Mlp` and `Lstm` load, save and run networks with nothing but numpy. `convert_torch`,
`convert_torch_lstm` (extra `walkerkit[torch]`) and `convert_onnx` (extra `walkerkit[onnx]`) make
their files from those of other libraries; `train_mlp_actuator` (extra `walkerkit[torch]`) makes one
from a log.
"""

from walkerkit.actuators.networks.activations import ACTIVATIONS
from walkerkit.actuators.networks.convert_onnx import convert_onnx
from walkerkit.actuators.networks.convert_torch import convert_torch
from walkerkit.actuators.networks.convert_torch_lstm import convert_torch_lstm
from walkerkit.actuators.networks.history import History, InputOrder
from walkerkit.actuators.networks.lstm import Lstm, LstmForward
from walkerkit.actuators.networks.mlp import Mlp, MlpForward
from walkerkit.actuators.networks.train import train_mlp_actuator
from walkerkit.actuators.networks.trained import LearnedMlpFields, TrainedMlp

__all__ = [
    "ACTIVATIONS",
    "History",
    "InputOrder",
    "LearnedMlpFields",
    "Lstm",
    "LstmForward",
    "Mlp",
    "MlpForward",
    "TrainedMlp",
    "convert_onnx",
    "convert_torch",
    "convert_torch_lstm",
    "train_mlp_actuator",
]
