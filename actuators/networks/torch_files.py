"""What PyTorch saved, opened without unpickling anyone's objects."""

from __future__ import annotations

import copy
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def import_torch() -> Any:
    """The module `torch`, which only conversion and training need.

    Raises:
        ImportError: It is not installed.
    """
    try:
        import torch
    except ImportError as error:
        raise ImportError(
            "this needs PyTorch, which is not installed: pip install 'walkerkit[torch]'"
        ) from error
    return torch


@contextmanager
def torchscript_allowed() -> Iterator[None]:
    """Silences PyTorch's announcements that TorchScript, which files are in, is deprecated."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def open_source(source: Any) -> tuple[str, Any]:
    """Opens a network of PyTorch.

    Args:
        source: path of a TorchScript or state-dict `.pt`, a `torch.nn.Module`, or a state dict.

    Returns:
        Its name for errors, and a module or a state dict (name → tensor). A module is a copy in
        double precision on the CPU, in evaluation mode.

    Raises:
        FileNotFoundError: There is no such file.
        TypeError: `source` is none of these.
        ValueError: The file is damaged, or holds pickled objects or something else.
    """
    torch = import_torch()
    if isinstance(source, str | Path):
        name = str(source)
        opened = _load(torch, Path(source))
    elif isinstance(source, torch.nn.Module):
        name = f"the module {getattr(source, 'original_name', type(source).__name__)}"
        opened = source
    elif isinstance(source, Mapping):
        name, opened = "the state dict", source
    else:
        raise TypeError(
            f"`source` is a {type(source).__name__}: give the path of a .pt, a torch.nn.Module or "
            "a state dict"
        )
    if isinstance(opened, torch.nn.Module):
        with torchscript_allowed(), torch.no_grad():
            return name, copy.deepcopy(opened).cpu().double().eval()
    return name, _checked_state(torch, name, opened)


def as_array(tensor: Any) -> FloatArray:
    """A tensor's numbers in double precision."""
    array: FloatArray = tensor.detach().cpu().double().numpy()
    return array


def _load(torch: Any, path: Path) -> Any:
    if not path.is_file():
        raise FileNotFoundError(
            f"the network file {path} does not exist: relative paths start at {Path.cwd()}"
        )
    try:
        if _is_torchscript(path):
            with torchscript_allowed():
                return torch.jit.load(str(path), map_location="cpu")
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch's readers raise RuntimeError, KeyError, EOFError, …
        reason = str(error).strip().partition("\n")[0]
        raise ValueError(
            f"{path}: cannot be read ({type(error).__name__}: {reason}): it should be complete, "
            "and hold TorchScript (torch.jit.save) or a state dict "
            "(torch.save(module.state_dict(), path)); a pickled module is never loaded, but the "
            "module itself can be given instead of a path"
        ) from error


def _is_torchscript(path: Path) -> bool:
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith("/constants.pkl") for name in archive.namelist())


def _checked_state(torch: Any, name: str, state: Any) -> Mapping[str, Any]:
    if not isinstance(state, Mapping) or not state:
        raise ValueError(
            f"{name}: holds {type(state).__name__}, expected a state dict with the network's "
            "weights: save module.state_dict()"
        )
    for key, value in state.items():
        if not isinstance(value, torch.Tensor):
            remedy = (
                f"give torch.load(path, weights_only=True)[{key!r}] if that is the state dict"
                if isinstance(value, Mapping)
                else "keep only the network's weights"
            )
            raise ValueError(
                f"{name}: entry {key!r} is a {type(value).__name__}, expected a tensor: {remedy}"
            )
    return state
