"""LSTM networks of PyTorch as `.npz`, with the extra `walkerkit[torch]`.

    convert_torch_lstm("ankle_lstm.pt", "ankle.npz")

A network has to be one `torch.nn.LSTM` and one linear layer behind it, whatever their names. Before
anything is saved, the weights are run by PyTorch's own LSTM on random sequences, which has to give
the same to 1e-6 of the largest output. What else the network's own `forward` does, say scaling,
is not seen: put it into the actuator's scales.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from walkerkit.actuators.networks.archive import check_npz
from walkerkit.actuators.networks.chain import check_close
from walkerkit.actuators.networks.lstm import Lstm
from walkerkit.actuators.networks.torch_files import as_array, import_torch, open_source

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
    state = opened if isinstance(opened, Mapping) else opened.state_dict()
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
    lstm = _build(name, recurrent, head)
    _verify(name, lstm)
    lstm.save(out)
    return lstm


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
