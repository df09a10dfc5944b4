"""Networks of PyTorch, converted and held against what PyTorch makes of the same inputs."""

import collections
import copy
import pickle
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from walkerkit.actuators.networks import Mlp, convert_torch

torch.set_num_threads(1)  # small networks only wait for each other

# TorchScript is deprecated, and still what the networks of many robots are in.
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")

MODULES = {
    "elu": nn.ELU,
    "relu": nn.ReLU,
    "tanh": nn.Tanh,
    "softsign": nn.Softsign,
    "sigmoid": nn.Sigmoid,
    "identity": nn.Identity,
    "leaky_relu": nn.LeakyReLU,
    "leaky_relu(0.2)": lambda: nn.LeakyReLU(0.2),
    "elu(0.5)": lambda: nn.ELU(0.5),
    "silu": nn.SiLU,
    "gelu": nn.GELU,
    "gelu_tanh": lambda: nn.GELU(approximate="tanh"),
}


class Normalised(nn.Module):
    """Means and deviations before, a batch norm between, and what undoes them behind."""

    def __init__(self):
        super().__init__()
        for name in ("mean", "deviation"):
            self.register_buffer(name, torch.rand(6) + 0.5)
        self.body = nn.Sequential(
            nn.Linear(6, 8), nn.BatchNorm1d(8), nn.ELU(), nn.BatchNorm1d(8), nn.Linear(8, 2)
        )
        for norm in (self.body[1], self.body[3]):
            for tensor in (norm.running_mean, norm.running_var, norm.weight.data, norm.bias.data):
                tensor.uniform_(0.5, 1.5)
        self.register_buffer("scale", torch.rand(2) + 1)

    def forward(self, x):
        y = self.body((x - self.mean) / self.deviation)
        return 3.0 - 2.0 * (y * self.scale + 0.25)


class Squashed(nn.Module):
    """Scales on both sides of the last activation, and signs."""

    def __init__(self):
        super().__init__()
        self.first, self.last = nn.Linear(6, 4, bias=False), nn.Linear(4, 3)

    def forward(self, x):
        y = self.last(torch.sub(-self.first(x * 0.5), 0.3, alpha=2.0).tanh() / 4.0)
        return 20.0 * torch.tanh(y * 0.1) + 1.0


class Functional(nn.Module):
    """Activations as calls, dropout, in-place operations, and a bias of its own."""

    def __init__(self):
        super().__init__()
        self.first = nn.Linear(6, 16)
        self.second = nn.Linear(16, 12, bias=False)
        self.drop = nn.Dropout(0.5)
        self.weight = nn.Parameter(torch.randn(5, 12))
        self.bias = nn.Parameter(torch.randn(5))
        self.last = nn.Sequential(nn.Linear(5, 5, bias=False), nn.Softsign(), nn.Linear(5, 2))

    def forward(self, x):
        x = functional.elu(self.first(x))
        x = torch.relu_(self.second(self.drop(x)))
        x = torch.addmm(self.bias, x, self.weight.t()).sigmoid()
        return torch.tanh(self.last(x))


class Separate(nn.Module):
    """A product and a sum in place of a linear layer."""

    def __init__(self):
        super().__init__()
        self.weight = nn.Parameter(torch.randn(5, 6))
        self.bias = nn.Parameter(torch.randn(5))

    def forward(self, x):
        return functional.softsign(x.matmul(self.weight.t()) + self.bias)


def sequential(activation="softsign", sizes=(6, 32, 32, 1)):
    torch.manual_seed(0)
    layers = []
    for before, after in pairwise(sizes[:-1]):
        layers += [nn.Linear(before, after), MODULES[activation]()]
    return nn.Sequential(*layers, nn.Linear(*sizes[-2:])).eval()


def seeded(kind):
    torch.manual_seed(1)
    return kind().eval()


def scripted(module):
    return torch.jit.script(module)


def traced(module):
    return torch.jit.trace(module, torch.zeros(2, 6))


def frozen(module):
    return torch.jit.freeze(torch.jit.script(module))


def assert_same(mlp, module, seed=0):
    """To 1e-6, with torch in single precision as it was trained; in double to rounding."""
    x = torch.from_numpy(np.random.default_rng(seed).normal(size=(200, 6)))
    with torch.no_grad():
        single = module(x.float()).numpy()
        double = copy.deepcopy(module).double()(x).numpy()
    np.testing.assert_allclose(mlp(x.float()), single, rtol=0, atol=1e-6)
    np.testing.assert_allclose(mlp(x), double, rtol=0, atol=1e-13 * np.abs(double).max())


class TestMatches:
    @pytest.mark.parametrize("as_file", [scripted, traced, frozen])
    @pytest.mark.parametrize("activation", MODULES)
    def test_file_of_torchscript(self, tmp_path, as_file, activation):
        module = sequential(activation)
        path, out = tmp_path / "net.pt", tmp_path / "net.npz"
        torch.jit.save(as_file(module), str(path))
        mlp = convert_torch(path, out)
        assert mlp.activations == (activation, activation, "identity")
        assert_same(mlp, module)
        assert_same(Mlp.load(out), module, seed=1)

    @pytest.mark.parametrize("as_module", [lambda module: module, scripted, traced])
    @pytest.mark.parametrize("kind", [Functional, Separate, Normalised, Squashed])
    def test_other_ways_to_write_it(self, tmp_path, as_module, kind):
        module = seeded(kind)
        mlp = convert_torch(as_module(module), tmp_path / "net.npz")
        if kind is Functional:
            assert mlp.activations == ("elu", "relu", "sigmoid", "softsign", "tanh")
        assert_same(mlp, module)

    @pytest.mark.parametrize("from_path", [True, False])
    def test_state_dict(self, tmp_path, from_path):
        module = sequential("elu")
        source = tmp_path / "weights.pt" if from_path else module.state_dict()
        if from_path:
            torch.save(module.state_dict(), source)
        mlp = convert_torch(source, tmp_path / "net.npz", activations=("elu", "elu", "identity"))
        assert_same(mlp, module)
        assert_same(Mlp.load(tmp_path / "net.npz"), module)

    def test_state_dict_without_biases(self, tmp_path):
        module = nn.Sequential(nn.Linear(6, 4, bias=False), nn.Tanh(), nn.Linear(4, 1, bias=False))
        mlp = convert_torch(module.state_dict(), tmp_path / "n.npz", activations=["tanh"] * 2)
        assert_same(mlp, nn.Sequential(module, nn.Tanh()))

    def test_leaves_the_module_as_it_was(self, tmp_path):
        module = nn.Sequential(nn.Linear(6, 1), nn.Dropout()).train()
        convert_torch(module, tmp_path / "net.npz")
        assert module.training
        assert module[0].weight.dtype == torch.float32

    def test_activations_that_agree(self, tmp_path):
        names = ("relu", "relu", "identity")
        assert convert_torch(sequential("relu"), tmp_path / "n.npz", activations=names)


class Inverse(nn.Module):
    def __init__(self):
        super().__init__()
        self.net = sequential()

    def forward(self, x):
        return 10.0 / self.net(x)


class ThroughNothing(Inverse):
    def forward(self, x):
        return self.net(x / 0.0)


class Residual(nn.Module):
    def __init__(self):
        super().__init__()
        self.inner = nn.Linear(6, 6)
        self.outer = nn.Linear(6, 1)

    def forward(self, x):
        return self.outer(x + torch.tanh(self.inner(x)))


class Skipping(nn.Module):
    def __init__(self):
        super().__init__()
        self.first, self.second = nn.Linear(6, 6), nn.Linear(6, 6)

    def forward(self, x):
        return self.second(x) + 0 * self.first(x)


class TwoInputs(nn.Module):
    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x, y):
        return self.layer(x) + y


class Pair(nn.Module):
    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x):
        y = self.layer(x)
        return y, y


class Squeezed(nn.Module):
    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x):
        return self.layer(x).squeeze(-1)


class Ratio(nn.Module):
    """Nearly softsign."""

    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x):
        y = self.layer(x)
        return y / (y.abs() + 2)


class Denominator(nn.Module):
    """The first half of softsign."""

    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x):
        return self.layer(x).abs() + 1


def body(*modules):
    return nn.Sequential(
        collections.OrderedDict(body=nn.Sequential(nn.Linear(6, 6), *modules), head=nn.Linear(6, 1))
    )


REFUSED = {
    "layer norm": (lambda: body(nn.LayerNorm(6)), "`aten::layer_norm` of module `body.1`"),
    "mish": (lambda: body(nn.Mish()), "`aten::mish` of module `body.1`.*gelu_tanh"),
    "selu": (lambda: body(nn.SELU()), "`aten::selu` of module `body.1`|factors are"),
    "fitting norm": (
        lambda: body(nn.BatchNorm1d(6, track_running_stats=False)),
        "takes its means from what it is given|its forward fails",
    ),
    "inverse": (Inverse, "`aten::div`.*divides by the layer|`aten::reciprocal`"),
    "through nothing": (ThroughNothing, "its numbers are not finite"),
    "twice": (lambda: body(nn.Tanh(), nn.ReLU()), "`aten::relu` of module `body.2`.*follow"),
    "first": (lambda: nn.Sequential(nn.Tanh(), nn.Linear(6, 1)), "`aten::tanh` of module `0`"),
    "residual": (Residual, "`aten::add` cannot be converted"),
    "skipping": (Skipping, "`aten::linear` of module `second`|`aten::linear` of module `first`"),
    "pair": (Pair, "it returns something else than its last layer"),
    "ratio": (Ratio, "`aten::add` cannot be converted"),
    "denominator": (Denominator, "it returns something else than its last layer"),
    "squeezed": (Squeezed, "`aten::squeeze`"),
    "no layer": (nn.Tanh, "there is no linear layer|`aten::tanh`"),
}


@pytest.mark.parametrize("as_module", [lambda module: module, scripted])
@pytest.mark.parametrize("name", REFUSED)
def test_not_a_chain(tmp_path, name, as_module):
    make, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        convert_torch(as_module(seeded(make)), tmp_path / "net.npz")
    assert not (tmp_path / "net.npz").exists()


def test_two_inputs(tmp_path):
    with pytest.raises(ValueError, match="it takes 2 inputs, not one"):
        convert_torch(scripted(TwoInputs()), tmp_path / "net.npz")
    with pytest.raises(ValueError, match=r"its forward fails for .* n one of \[6\]"):
        convert_torch(TwoInputs(), tmp_path / "net.npz")


class Switching(nn.Module):
    """What tracing sees of it on one input is not what it does on others."""

    def __init__(self):
        super().__init__()
        self.layer = nn.Linear(6, 1)

    def forward(self, x):
        return self.layer(x) if float(x.sum()) == 0 else -self.layer(x)


@pytest.mark.filterwarnings("ignore:Converting a tensor:torch.jit.TracerWarning")
def test_differs_from_its_source(tmp_path):
    with pytest.raises(ValueError, match="the converted network differs by"):
        convert_torch(Switching(), tmp_path / "net.npz")
    assert not (tmp_path / "net.npz").exists()


class TestStateDict:
    def refused(self, state, tmp_path, activations=("tanh", "identity")):
        with pytest.raises(ValueError) as caught:
            convert_torch(state, tmp_path / "net.npz", activations=activations)
        assert not (tmp_path / "net.npz").exists()
        return str(caught.value)

    @pytest.mark.parametrize("activations", [None, (), ("tanh",), "tanh"])
    def test_activations_are_needed(self, tmp_path, activations):
        state = sequential(sizes=(6, 4, 1)).state_dict()
        message = self.refused(state, tmp_path, activations)
        assert "one name for each of the 2 layers (0, 2)" in message

    def test_unknown_activation(self, tmp_path):
        state = sequential(sizes=(6, 4, 1)).state_dict()
        assert "did you mean 'elu'" in self.refused(state, tmp_path, ("ELU", "identity"))

    def test_other_parameters(self, tmp_path):
        state = body(nn.BatchNorm1d(6)).state_dict()
        assert "entry `body.1.weight` with shape (6,)" in self.refused(state, tmp_path)

    def test_layers_out_of_order(self, tmp_path):
        state = sequential(sizes=(6, 4, 1)).state_dict()
        swapped = {key: state[key] for key in ("2.weight", "2.bias", "0.weight", "0.bias")}
        assert "`weight_1` has shape (4, 6), expected (any, 1)" in self.refused(swapped, tmp_path)

    def test_not_finite(self, tmp_path):
        state = sequential(sizes=(6, 4, 1)).state_dict()
        state["2.bias"][0] = torch.nan
        assert "layer `2`: `bias`[0] is nan" in self.refused(state, tmp_path)

    def test_bias_alone(self, tmp_path):
        assert "a bias but no weight" in self.refused({"0.bias": torch.zeros(2)}, tmp_path, ["elu"])

    def test_checkpoint(self, tmp_path):
        path = tmp_path / "checkpoint.pt"
        torch.save({"model_state_dict": sequential().state_dict(), "epoch": 3}, path)
        message = self.refused(path, tmp_path)
        assert "entry 'model_state_dict' is a" in message
        assert "torch.load(path, weights_only=True)['model_state_dict']" in message


class TestFiles:
    def test_missing(self, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.pt does not exist"):
            convert_torch(tmp_path / "nowhere.pt", tmp_path / "net.npz")

    @pytest.mark.parametrize("save", [torch.save, pickle.dumps])
    def test_pickled_module_is_not_loaded(self, tmp_path, save):
        path = tmp_path / "net.pt"
        if save is torch.save:
            torch.save(sequential(), path)
        else:
            path.write_bytes(pickle.dumps(sequential()))
        with pytest.raises(ValueError, match="a pickled module is never loaded"):
            convert_torch(path, tmp_path / "net.npz")

    @pytest.mark.parametrize("script", [True, False])
    @pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
    def test_truncated(self, tmp_path, share, script):
        path = tmp_path / "net.pt"
        if script:
            torch.jit.save(scripted(sequential()), str(path))
        else:
            torch.save(sequential().state_dict(), path)
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ValueError, match="cannot be read"):
            convert_torch(path, tmp_path / "net.npz", activations=["elu"])

    @pytest.mark.parametrize("content", [torch.ones(3), [1, 2], {}])
    def test_something_else(self, tmp_path, content):
        torch.save(content, tmp_path / "net.pt")
        with pytest.raises(ValueError, match="expected a state dict"):
            convert_torch(tmp_path / "net.pt", tmp_path / "net.npz")

    def test_wrong_out(self, tmp_path):
        with pytest.raises(ValueError, match=r"saved as \.npz"):
            convert_torch(sequential(), tmp_path / "net.pt")

    def test_wrong_source(self, tmp_path):
        with pytest.raises(TypeError, match="`source` is a int"):
            convert_torch(3, tmp_path / "net.npz")

    def test_activations_that_contradict(self, tmp_path):
        with pytest.raises(ValueError, match="leave `activations` out"):
            convert_torch(sequential(), tmp_path / "n.npz", activations=("elu", "elu", "identity"))
        assert not (tmp_path / "n.npz").exists()
