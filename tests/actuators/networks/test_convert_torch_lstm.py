"""LSTM networks of PyTorch, converted and held against what PyTorch makes of the same sequences."""

import numpy as np
import pytest
import torch
from torch import nn

from walkerkit.actuators.networks import Lstm, convert_torch_lstm

torch.set_num_threads(1)  # small networks only wait for each other

# TorchScript is deprecated, and still what the networks of many robots are in.
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")


class Net(nn.Module):
    def __init__(self, layers=2, bias=True, **options):
        super().__init__()
        torch.manual_seed(0)
        self.memory = nn.LSTM(2, 8, layers, bias=bias, **options)
        self.decoder = nn.Linear(8, 1, bias=bias)

    def forward(self, x):
        y, _ = self.memory(x)
        return self.decoder(y)


def assert_same(lstm, module):
    x = np.random.default_rng(0).normal(size=(50, 12, 2)).astype(np.float32)
    with torch.no_grad():
        expected = module(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(lstm(x), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("layers", [1, 2, 3])
@pytest.mark.parametrize("form", ["module", "state", "state file", "script file"])
def test_matches(tmp_path, form, layers, bias):
    module = Net(layers, bias)
    path, out = tmp_path / "net.pt", tmp_path / "net.npz"
    source = {"module": module, "state": module.state_dict()}.get(form, path)
    if form == "state file":
        torch.save(module.state_dict(), path)
    elif form == "script file":
        torch.jit.save(torch.jit.script(module), str(path))
    lstm = convert_torch_lstm(source, out)
    assert (lstm.n_layers, lstm.n_hidden, lstm.n_inputs, lstm.n_outputs) == (layers, 8, 2, 1)
    assert_same(lstm, module)
    assert_same(Lstm.load(out), module)


def test_step_by_step_is_the_sequence(tmp_path):
    """The state carried by PyTorch and ours agree after every step."""
    module = Net().double()
    forward = convert_torch_lstm(module, tmp_path / "net.npz").forward((12,))
    state = None
    for x in np.random.default_rng(0).normal(size=(30, 12, 2)):
        with torch.no_grad():
            y, state = module.memory(torch.from_numpy(x[None]), state)
            expected = module.decoder(y)[0].numpy()
        np.testing.assert_allclose(forward(x), expected, atol=1e-12)
        for layer in range(2):
            np.testing.assert_allclose(forward.hidden[layer], state[0][layer], atol=1e-12)
            np.testing.assert_allclose(forward.cell[layer], state[1][layer], atol=1e-12)


def without(state, *names):
    return {key: value for key, value in state.items() if key not in names}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: nn.Sequential(nn.Linear(2, 4), nn.Linear(4, 1)), r"entry `1\.weight`"),
        (lambda: nn.LSTM(2, 8), "the entries `weight_ih_l0`, .* are not one torch.nn.LSTM"),
        (lambda: Net(bidirectional=True), "entry `memory.weight_ih_l0_reverse`"),
        (lambda: Net(proj_size=3), "entry `memory.weight_hr_l0` with shape"),
        (lambda: nn.GRU(2, 8), "weight_ih_l0` has shape|are not one"),
        (lambda: nn.ModuleList([Net(1), Net(1)]), r"entry `1\.decoder\.weight`"),
        (lambda: nn.Sequential(nn.LSTM(2, 8), nn.LSTM(8, 8), nn.Linear(8, 1)), "are not one"),
        (lambda: without(Net(1).state_dict(), "memory.weight_hh_l0"), "got"),
        (lambda: without(Net(2).state_dict(), "memory.weight_ih_l0"), "got"),
    ],
)
def test_something_else(tmp_path, make, message):
    with pytest.raises(ValueError, match=message):
        convert_torch_lstm(make(), tmp_path / "net.npz")
    assert not (tmp_path / "net.npz").exists()


def test_differs_from_its_source(tmp_path, monkeypatch):
    """Were our equations wrong, nothing would be saved."""
    monkeypatch.setattr(Lstm, "__call__", lambda lstm, x: 1.001 * np.ones((*x.shape[:-1], 1)))
    with pytest.raises(ValueError, match="the converted network differs by"):
        convert_torch_lstm(Net(), tmp_path / "net.npz")
    assert not (tmp_path / "net.npz").exists()


def test_wrong_files(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        convert_torch_lstm(tmp_path / "nowhere.pt", tmp_path / "net.npz")
    with pytest.raises(ValueError, match=r"saved as \.npz"):
        convert_torch_lstm(Net(), tmp_path / "net.pt")
