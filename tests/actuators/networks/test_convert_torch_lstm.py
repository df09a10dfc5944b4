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


class Drive(nn.Module):
    """Like the public network of a series elastic drive: scales inside, a state that is passed."""

    def __init__(self, batch_first=True):
        super().__init__()
        torch.manual_seed(2)
        self.memory = nn.LSTM(2, 8, 2, batch_first=batch_first)
        self.decoder = nn.Linear(8, 1)
        self.register_buffer("mean", torch.tensor([0.02, -0.3]))
        self.register_buffer("deviation", torch.tensor([0.1, 2.5]))
        self.effort = 25.0

    def forward(self, x: torch.Tensor, state: tuple[torch.Tensor, torch.Tensor]):
        y, state = self.memory((x - self.mean) / self.deviation, state)
        return self.effort * self.decoder(y) - 0.5, state


class LastStep(nn.Module):
    def __init__(self):
        super().__init__()
        self.memory = nn.LSTM(2, 4)
        self.decoder = nn.Linear(4, 1)

    def forward(self, x):
        y, _ = self.memory(x * 3.0)
        return self.decoder(y[-1]).squeeze(-1) * 7.0


@pytest.mark.parametrize("batch_first", [True, False])
@pytest.mark.parametrize("form", ["module", "script file", "frozen file"])
def test_scales_inside_the_network_are_converted(tmp_path, form, batch_first):
    module = Drive(batch_first).eval()
    source = tmp_path / "net.pt"
    if form == "module":
        source = module
    elif form == "script file":
        torch.jit.save(torch.jit.script(module), str(source))
    else:
        torch.jit.save(torch.jit.freeze(torch.jit.script(module)), str(source))
    if form == "frozen file":  # has no names for its weights any more
        with pytest.raises(ValueError, match="are not one torch"):
            convert_torch_lstm(source, tmp_path / "net.npz")
        return
    lstm = convert_torch_lstm(source, tmp_path / "net.npz")
    x = np.random.default_rng(0).normal(size=(50, 12, 2)) * [0.1, 2.0]
    zeros = torch.zeros((2, 12, 8), dtype=torch.float64)
    given = torch.from_numpy(x.swapaxes(0, 1).copy() if batch_first else x)
    with torch.no_grad():
        y, _ = module.double()(given, (zeros, zeros))
    expected = y.numpy().swapaxes(0, 1) if batch_first else y.numpy()
    np.testing.assert_allclose(Lstm.load(tmp_path / "net.npz")(x), expected, atol=1e-5)
    np.testing.assert_allclose(lstm(x), expected, rtol=1e-6, atol=1e-6)
    assert np.abs(expected).max() > 1


def test_a_network_that_gives_its_last_step_alone(tmp_path):
    torch.manual_seed(3)
    module = LastStep()
    lstm = convert_torch_lstm(module, tmp_path / "net.npz")
    x = np.random.default_rng(0).normal(size=(20, 5, 2)).astype(np.float32)
    with torch.no_grad():
        expected = module(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(lstm(x)[-1, :, 0], expected, atol=1e-5)


class Clipped(Net):
    def forward(self, x):
        y, _ = self.memory(torch.clamp(x, -1.0, 1.0))
        return self.decoder(y)


class Squashed(Net):
    def forward(self, x):
        y, _ = self.memory(x)
        return torch.tanh(self.decoder(y))


class Residual(Net):
    def forward(self, x):
        y, _ = self.memory(x)
        return self.decoder(y) + x[..., :1]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Clipped, "before the LSTM there may be scales and offsets alone"),
        (Squashed, "what comes behind the LSTM is not"),
        (Residual, "cannot be converted"),
    ],
)
def test_what_else_a_network_does_is_refused(tmp_path, kind, message):
    with pytest.raises(ValueError, match=message):
        convert_torch_lstm(kind(), tmp_path / "net.npz")
    assert not (tmp_path / "net.npz").exists()


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
