"""What is said where an optional package is missing, and that the rest does without."""

import subprocess
import sys

import numpy as np
import pytest

from walkerkit.actuators.networks import (
    convert_onnx,
    convert_torch,
    convert_torch_lstm,
    train_mlp_actuator,
)


@pytest.mark.parametrize("convert", [convert_torch, convert_torch_lstm])
def test_conversion_without_torch(monkeypatch, tmp_path, convert):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match=r"pip install 'walkerkit\[torch\]'"):
        convert("net.pt", tmp_path / "net.npz")


def test_training_without_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match=r"pip install 'walkerkit\[torch\]'"):
        train_mlp_actuator(*np.ones((3, 100, 1)))


def test_conversion_without_onnx(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match=r"pip install 'walkerkit\[onnx\]'"):
        convert_onnx("net.onnx", tmp_path / "net.npz")


def test_importing_loads_neither():
    code = (
        "import sys, walkerkit.actuators.networks\n"
        "sys.exit(' '.join({'torch', 'onnx'} & sys.modules.keys()) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
