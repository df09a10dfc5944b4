"""Policies of Python, ONNX and TorchScript: one network acts the same in all of them."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.gap.policy.balance import GAINS, make_environment, pendulum, policy, saved
from tests.gap.refused import refused
from walkerkit import gap
from walkerkit.gap.policy.loading import load_policy

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")


def seen(**observation: Any) -> Any:
    return SimpleNamespace(observation=observation)


TWO = seen(**{"robot/joints_pos": np.array([[0.3]]), "robot/joints_vel": np.array([[-1.0]])})


@pytest.fixture
def torchscript(tmp_path: Path) -> Path:
    torch = pytest.importorskip("torch")
    network = torch.nn.Sequential(torch.nn.Linear(2, 1, bias=False), torch.nn.Hardtanh())
    with torch.no_grad():
        network[0].weight[:] = torch.from_numpy(GAINS)
    torch.jit.script(network).save(str(tmp_path / "walk.pt"))
    return tmp_path / "walk.pt"


def onnx_file(path: Path, inputs: dict[str, int]) -> Path:
    """The policy of `balance` in ONNX, of one input or of two."""
    onnx = pytest.importorskip("onnx")
    helper, numbers = onnx.helper, onnx.TensorProto.FLOAT
    nodes = []
    (first, *others) = inputs
    whole = first
    if others:
        whole = "whole"
        nodes.append(helper.make_node("Concat", [*inputs], [whole], axis=1))
    nodes += [
        helper.make_node("MatMul", [whole, "gains"], ["asked"]),
        helper.make_node("Clip", ["asked", "low", "high"], ["action"]),
    ]
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info(n, numbers, [1, size]) for n, size in inputs.items()],
        [helper.make_tensor_value_info("action", numbers, [1, 1])],
        [
            helper.make_tensor("gains", numbers, [2, 1], GAINS.ravel()),
            helper.make_tensor("low", numbers, [], [-1.0]),
            helper.make_tensor("high", numbers, [], [1.0]),
        ],
    )
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), path)
    return path


def test_they_all_ask_for_the_same(tmp_path: Path, torchscript: Path) -> None:
    whole = onnx_file(tmp_path / "whole.onnx", {"obs": 2})
    named = onnx_file(tmp_path / "named.onnx", {"joints_pos": 1, "robot/joints_vel": 1})
    for file in (torchscript, whole, named):
        np.testing.assert_allclose(load_policy(file)(TWO), policy(TWO), rtol=1e-6)


def test_a_network_is_rolled_out_as_the_function_is(tmp_path: Path, torchscript: Path) -> None:
    model = pendulum(tmp_path / "robot")
    folder = saved(tmp_path / "result", model, {"sensor_delay": {"delay": 0.06}})
    by_file = gap.policy_gap(make_environment, torchscript, folder, model=model, episodes=3)
    assert by_file.blamed == ("sensor_delay",)


def test_without_a_runtime_onnx_s_own_evaluator_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = onnx_file(tmp_path / "walk.onnx", {"obs": 2})
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    np.testing.assert_allclose(load_policy(file)(TWO), policy(TWO), rtol=1e-6)
    monkeypatch.setitem(sys.modules, "onnx", None)
    refused(lambda: load_policy(file), "pip install onnxruntime")


def test_without_torch_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "walk.pt").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "torch", None)
    refused(lambda: load_policy(tmp_path / "walk.pt"), "pip install 'walkerkit[torch]'")


def test_functions_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "walks.py").write_text(
        "import numpy as np\n"
        "def hold(timestep): return np.zeros(1)\n"
        "class Count:\n"
        "    def __init__(self): self.n = 0\n"
        "    def __call__(self, timestep): self.n += 1; return np.full(1, self.n)\n"
        "def make(): return hold\n"
        "def none(): return 3\n"
        "def bad(): raise KeyError('weights')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load_policy("walks:hold")(TWO) == 0
    assert load_policy("walks:make")(TWO) == 0
    counting = load_policy("walks:Count")
    assert [float(counting(TWO)[0]) for _ in range(2)] == [1, 2]
    refused(lambda: load_policy("walks:none"), "walks:none", "int")
    refused(lambda: load_policy("walks:bad"), "walks:bad", "KeyError")
    refused(lambda: load_policy("walks:hol"), "no function 'hol'", "'hold'")


def test_a_network_of_another_size_says_which(tmp_path: Path, torchscript: Path) -> None:
    three = seen(joints_pos=np.zeros(3))
    refused(lambda: load_policy(torchscript)(three), "walk.pt", "joints_pos 3")
    named = onnx_file(tmp_path / "named.onnx", {"joints_pos": 1, "joints_velocity": 1})
    refused(lambda: load_policy(named)(TWO), "'joints_velocity'", "joints_vel")


@pytest.mark.parametrize("name", ["walk.onnx", "walk.pt"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, name: str) -> None:
    pytest.importorskip("onnx" if name.endswith("onnx") else "torch")
    (tmp_path / name).write_bytes(b"nothing of the kind")
    refused(lambda: load_policy(tmp_path / name), name, "cannot be read as")
