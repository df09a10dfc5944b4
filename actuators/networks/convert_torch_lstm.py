"""LSTM networks of PyTorch as `.npz`, with the extra `walkerkit[torch]`.

    convert_torch_lstm("ankle_lstm.pt", "ankle.npz")

A network has to be one `torch.nn.LSTM` and one linear layer behind it, whatever their names, with
fixed scales and offsets (means, deviations) before and behind them, which become part of the
weights: the actuator's own scales are then those of units alone. Before anything is saved, the
network's own `forward` is run on random sequences, and what is converted has to give the same to
1e-6 of the largest output (1e-5 in single precision). It may take a sequence, or a sequence and the
LSTM's state.

A state dict has the weights alone: what else its network does has to be in the actuator's scales.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from walkerkit.actuators.networks.archive import check_npz
from walkerkit.actuators.networks.chain import SINGLE_TOLERANCE, TOLERANCE, check_close
from walkerkit.actuators.networks.lstm import Lstm
from walkerkit.actuators.networks.torch_files import (
    as_array,
    import_torch,
    open_source,
    torchscript_allowed,
)
from walkerkit.actuators.networks.torch_lstm_graph import LstmGraphReader

_RECURRENT = re.compile(r"(?P<kind>(weight|bias)_(ih|hh))_l(?P<layer>\d+)")
_STEPS, _ROWS = 40, 16


def convert_torch_lstm(source: Any, out: Path | str) -> Lstm:
    """Converts an LSTM with a linear head and saves it.

    Args:
        source: path of a TorchScript or state-dict `.pt`, a `torch.nn.Module`, or a state dict.
        out: the `.npz` to write.

    Returns:
        The network, as saved.

    Raises:
        FileNotFoundError: `source` or the folder of `out` does not exist.
        ImportError: PyTorch is not installed.
        TypeError: `source` is none of these.
        ValueError: There is something else in the network (names the entry), something is missing,
            or the conversion is not exact.
    """
    check_npz(out)
    name, opened = open_source(source)
    if isinstance(opened, Mapping):
        lstm = _from_state(name, opened)
        _verify(name, lstm)
    else:
        lstm = _from_module(name, opened)
    lstm.save(out)
    return lstm


def _from_state(name: str, state: Mapping[str, Any]) -> Lstm:
    """The network of an LSTM's and a linear layer's weights."""
    recurrent: dict[str, dict[int, Any]] = {}
    head: dict[str, Any] = {}
    prefixes: set[str] = set()
    for key, tensor in state.items():
        prefix, _, last = key.rpartition(".")
        found = _RECURRENT.fullmatch(last)
        if found:
            recurrent.setdefault(found["kind"], {})[int(found["layer"])] = as_array(tensor)
            prefixes.add(prefix)
        elif (last, tensor.ndim) in (("weight", 2), ("bias", 1)) and last not in head:
            head[last] = as_array(tensor)
        else:
            raise _refusal(name, f"entry `{key}` with shape {tuple(tensor.shape)} is not part of")
    if "weight" not in head or not recurrent or len(prefixes) > 1:
        raise _refusal(name, f"the entries {', '.join(f'`{key}`' for key in state)} are not")
    return _build(name, recurrent, head)


def _from_module(name: str, module: Any) -> Lstm:
    """The network with all that its forward does, held against that."""
    parameters = dict(module.named_parameters())
    plain = _from_state(name, {k: v for k, v in module.state_dict().items() if k in parameters})
    reader = LstmGraphReader(name, module)
    behind = reader.behind.build()
    if len(behind.weights) != 1 or behind.activations != ("identity",):
        raise _refusal(name, "what comes behind the LSTM is not")
    scale, shift = (np.broadcast_to(one, (plain.n_inputs,)) for one in reader.before)
    lstm = Lstm(
        weights_ih=[plain.weights_ih[0] * scale, *plain.weights_ih[1:]],
        weights_hh=plain.weights_hh,
        biases_ih=[plain.biases_ih[0] + plain.weights_ih[0] @ shift, *plain.biases_ih[1:]],
        biases_hh=plain.biases_hh,
        head_weight=behind.weights[0],
        head_bias=behind.biases[0],
    )
    _verify_forward(name, lstm, module, batch_first=reader.batch_first)
    return lstm


def _verify_forward(name: str, lstm: Lstm, module: Any, *, batch_first: bool) -> None:
    """Holds a network against the module's own forward."""
    torch = import_torch()
    x = np.random.default_rng(0).normal(size=(_STEPS, _ROWS, lstm.n_inputs))
    constants = [*module.parameters(), *module.buffers()]
    is_single = any(one.dtype == torch.float32 for one in constants)
    dtype = torch.float32 if is_single else torch.float64
    given = torch.from_numpy(x.swapaxes(0, 1) if batch_first else x).to(dtype)
    zeros = torch.zeros((lstm.n_layers, _ROWS, lstm.n_hidden), dtype=dtype)
    reasons = []
    with torch.no_grad(), torchscript_allowed():
        for arguments in ((given,), (given, (zeros, zeros)), (given, zeros, zeros)):
            try:
                made = module(*arguments)
                break
            except Exception as error:  # the module's own code runs here
                reasons.append(str(error).strip().partition("\n")[0])
        else:
            raise ValueError(
                f"{name}: its forward takes neither a sequence {tuple(given.shape)} nor that and "
                f"the LSTM's state ({reasons[0]}): give a module that does, or its state dict"
            )
    theirs = as_array(made[0] if isinstance(made, tuple) else made)
    ours = lstm(x)
    if theirs.size == ours[-1].size:  # the last step alone
        ours = ours[-1]
    elif batch_first:
        ours = ours.swapaxes(0, 1)
    if theirs.size != ours.size:
        raise ValueError(
            f"{name}: gives outputs of shape {theirs.shape} for {_STEPS} steps of {_ROWS} rows: "
            "give a network with one output for each"
        )
    tolerance = SINGLE_TOLERANCE if is_single else TOLERANCE
    check_close(name, ours.reshape(theirs.shape), theirs, tolerance=tolerance)


def _refusal(name: str, what: str) -> ValueError:
    return ValueError(
        f"{name}: {what} one torch.nn.LSTM (of one direction, without projection) and one linear "
        "layer: give a network of these two"
    )


def _build(name: str, recurrent: dict[str, dict[int, Any]], head: dict[str, Any]) -> Lstm:
    layers = sorted(recurrent.get("weight_hh", {}))
    rows = {layer: len(recurrent["weight_hh"][layer]) for layer in layers}

    def listed(kind: str) -> list[Any]:
        entries = recurrent.get(kind, {})
        if kind.startswith("bias"):  # torch.nn.LSTM(bias=False) has none
            entries = {layer: np.zeros(rows[layer]) for layer in layers} | entries
        return [entries[layer] for layer in sorted(entries)]

    try:
        return Lstm(
            weights_ih=listed("weight_ih"),
            weights_hh=listed("weight_hh"),
            biases_ih=listed("bias_ih"),
            biases_hh=listed("bias_hh"),
            head_weight=head["weight"],
            head_bias=head.get("bias", np.zeros(len(head["weight"]))),
        )
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _verify(name: str, lstm: Lstm) -> None:
    torch = import_torch()
    reference = torch.nn.LSTM(lstm.n_inputs, lstm.n_hidden, lstm.n_layers, dtype=torch.float64)
    with torch.no_grad():
        for layer in range(lstm.n_layers):
            for kind, arrays in (
                ("weight_ih", lstm.weights_ih),
                ("weight_hh", lstm.weights_hh),
                ("bias_ih", lstm.biases_ih),
                ("bias_hh", lstm.biases_hh),
            ):
                getattr(reference, f"{kind}_l{layer}").copy_(torch.tensor(arrays[layer]))
        x = np.random.default_rng(0).normal(size=(_STEPS, _ROWS, lstm.n_inputs))
        hidden, _ = reference(torch.from_numpy(x))
        y = torch.nn.functional.linear(
            hidden, torch.tensor(lstm.head_weight), torch.tensor(lstm.head_bias)
        )
    check_close(name, lstm(x), as_array(y))
