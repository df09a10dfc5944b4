"""Networks of PyTorch as `.npz`, with the extra `walkerkit[torch]`.

    convert_torch("ankle.pt", "ankle.npz")                    # TorchScript
    convert_torch("weights.pt", "ankle.npz", activations=("elu", "elu", "identity"))
    convert_torch(module, "ankle.npz")                        # a torch.nn.Module

A network has to be a plain chain of linear layers, each followed by at most one of the activations
of `networks.activations`. Fixed scales, offsets, means and deviations (also a batch norm's) before,
between and behind them become part of the layers. A state dict holds weights only: its activations
have to be given, one for each layer, and its layers are taken in the order in which it lists them.
No pickled object is ever loaded.

Before anything is saved, the network is held against its source on random inputs, to 1e-6 of the
largest output. (A frozen TorchScript file can only be asked in the precision of its constants; in
single precision 1e-5 is allowed.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.activations import check_activation, split
from walkerkit.actuators.networks.archive import check_npz
from walkerkit.actuators.networks.chain import SINGLE_TOLERANCE, TOLERANCE, Chain, verify
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.actuators.networks.torch_files import (
    as_array,
    import_torch,
    open_source,
    torchscript_allowed,
)
from walkerkit.actuators.networks.torch_graph import GraphReader

FloatArray = NDArray[np.float64]


def convert_torch(source: Any, out: Path | str, *, activations: Sequence[str] | None = None) -> Mlp:
    """Converts a network of PyTorch and saves it.

    Args:
        source: path of a TorchScript or state-dict `.pt`, a `torch.nn.Module`, or a state dict.
        out: the `.npz` to write.
        activations: the name of each layer's activation ("identity" for none). A state dict needs
            them; otherwise they are read from the network and need not be given.

    Returns:
        The network, as saved.

    Raises:
        FileNotFoundError: `source` or the folder of `out` does not exist.
        ImportError: PyTorch is not installed.
        TypeError: `source` is none of these.
        ValueError: The network is not such a chain (names the module that is not), its activations
            are missing or others than those given, or the conversion is not exact.
    """
    check_npz(out)
    name, opened = open_source(source)
    if isinstance(opened, Mapping):
        mlp = _from_state(name, opened, activations)
    else:
        with torchscript_allowed():
            mlp = _from_module(name, opened)
        if activations is not None and tuple(activations) != mlp.activations:
            raise ValueError(
                f"{name}: its activations are {mlp.activations}, but `activations` is "
                f"{tuple(activations)}: leave `activations` out"
            )
    mlp.save(out)
    return mlp


def _from_module(name: str, module: Any) -> Mlp:
    torch = import_torch()
    scripted = module if isinstance(module, torch.jit.ScriptModule) else _trace(name, module)
    frozen = torch.jit.freeze(scripted, optimize_numerics=False)
    mlp = GraphReader(name, scripted, frozen).read().build()

    constants = [node.output().toIValue() for node in frozen.graph.findAllNodes("prim::Constant")]
    is_single = any(isinstance(c, torch.Tensor) and c.dtype == torch.float32 for c in constants)
    dtype = torch.float32 if is_single else torch.float64

    def evaluate(x: FloatArray) -> FloatArray:
        # The module itself, of which a trace knows only what it did once.
        with torch.no_grad():
            return as_array(module(torch.from_numpy(x).to(dtype)))

    verify(name, mlp, evaluate, tolerance=SINGLE_TOLERANCE if is_single else TOLERANCE)
    return mlp


def _trace(name: str, module: Any) -> Any:
    torch = import_torch()
    # The first layer's weight need not be the first parameter.
    widths = {int(matrix.shape[1]): None for matrix in module.parameters() if matrix.ndim == 2}
    reason: Exception | None = None
    for width in widths:
        example = torch.zeros((2, width), dtype=torch.float64)
        try:
            return torch.jit.trace(module, example, check_trace=False)
        except Exception as error:  # the module's own code runs here
            reason = reason or error
    if reason is None:
        raise ValueError(f"{name}: there is no linear layer: give the network itself")
    raise ValueError(
        f"{name}: its forward fails for (2, n) features with n one of {list(widths)}, as its "
        f"weights suggest ({reason}): give a module whose forward takes the features alone"
    ) from reason


def _from_state(name: str, state: Mapping[str, Any], activations: Sequence[str] | None) -> Mlp:
    layers: dict[str, dict[str, Any]] = {}
    chain = Chain(name)
    for key, tensor in state.items():
        prefix, _, kind = key.rpartition(".")
        if (kind, tensor.ndim) not in (("weight", 2), ("bias", 1)):
            raise chain.refusal(
                f"entry `{key}` with shape {tuple(tensor.shape)}",
                "it is neither the weight nor the bias of a linear layer",
            )
        layers.setdefault(prefix, {})[kind] = tensor
    if activations is None or isinstance(activations, str) or len(activations) != len(layers):
        raise ValueError(
            f"{name}: a state dict does not hold activations, and `activations` is "
            f"{activations!r}: give one name for each of the {len(layers)} layers "
            f"({', '.join(layers)}), 'identity' for none"
        )
    for layer, (prefix, activation) in enumerate(zip(layers, activations, strict=True)):
        where = f"layer `{prefix}`"
        if "weight" not in layers[prefix]:
            raise chain.refusal(where, "it has a bias but no weight")
        bias = layers[prefix].get("bias")
        chain.linear(
            where, as_array(layers[prefix]["weight"]), None if bias is None else as_array(bias)
        )
        check_activation(f"`activations`[{layer}]", activation)
        if activation != "identity":
            chain.activation(where, activation)
    mlp = chain.build()
    verify(name, mlp, lambda x: _evaluate_state(list(layers.values()), activations, x))
    return mlp


def _evaluate_state(
    layers: Sequence[Mapping[str, Any]], activations: Sequence[str], x: FloatArray
) -> FloatArray:
    torch = import_torch()
    y = torch.from_numpy(x)
    for layer, activation in zip(layers, activations, strict=True):
        double = {kind: tensor.detach().cpu().double() for kind, tensor in layer.items()}
        y = torch.nn.functional.linear(y, double["weight"], double.get("bias"))
        y = _activated(torch.nn.functional, y, activation)
    return as_array(y)


def _activated(functional: Any, y: Any, activation: str) -> Any:
    plain, number = split(activation)
    if plain == "identity":
        return y
    if plain == "gelu_tanh":
        return functional.gelu(y, approximate="tanh")
    return getattr(functional, plain)(y, *([] if number is None else [number]))
