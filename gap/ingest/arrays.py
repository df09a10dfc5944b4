"""Arrays as logs: NPZ, NPY and PyTorch's .pt, as PACE and others keep them.

    log = read_arrays(Path("chirp_data.pt"))
    log.columns["dof_pos[3]"], log.topics[""].clocks["time"]

An array of (T, n) becomes the columns `<name>[0]` to `<name>[n-1]`, or has its joints' names there
where the file lists as many. Nothing is unpickled; `.pt` takes `pip install 'walkerkit[torch]'`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.npz import open_npz
from walkerkit.gap.errors import InputError, one_line, refusal
from walkerkit.gap.ingest.log import Log
from walkerkit.gap.ingest.tables import log_of
from walkerkit.gap.ingest.words import is_time
from walkerkit.gap.recordings.files import MOST_VALUES, check_file

Array = NDArray[Any]

_NAMES = ("joint_names", "joint_order", "dof_names", "names", "joints")


def read_arrays(path: Path) -> Log:
    """Reads all arrays of a file.

    Raises:
        ImportError: it takes PyTorch, which is not installed.
        InputError: it cannot be read, or says nothing of what its numbers are.
    """
    check_file(path)
    readers = {".npz": _npz, ".npy": _npy}
    try:
        found = readers.get(path.suffix.lower(), _torch)(path)
    except (InputError, ImportError):
        raise
    except Exception as error:  # parsers fail in many ways on a broken file; each is the file's
        raise refusal(
            f"{path}: it cannot be read as {path.suffix}: {one_line(error)}. Save plain arrays of "
            "numbers."
        ) from error
    return _log(path, found)


def _npz(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        archive = open_npz(file, most_bytes=8 * MOST_VALUES)
        return {name: archive[name] for name in archive.names}


def _npy(path: Path) -> dict[str, Any]:
    found = np.load(path, allow_pickle=False)
    if found.dtype.names is None:
        raise refusal(
            f"{path}: an array of the shape {found.shape} does not say what its numbers are. Save "
            'them by name: np.savez("log.npz", time=..., dof_pos=..., des_dof_pos=...).'
        )
    return {name: found[name] for name in found.dtype.names}


def _torch(path: Path) -> dict[str, Any]:
    try:
        import torch
    except ImportError:
        raise ImportError(
            "this needs the package torch, which is not installed: pip install 'walkerkit[torch]'"
        ) from None
    found = torch.load(path, map_location="cpu", weights_only=True)
    if not isinstance(found, Mapping):
        raise refusal(
            f"{path}: it holds {type(found).__name__}, which does not say what its numbers are. "
            'Save a dict: torch.save({"time": ..., "dof_pos": ..., "des_dof_pos": ...}, path).'
        )
    return {
        str(key): value.detach().numpy() if isinstance(value, torch.Tensor) else value
        for key, value in found.items()
    }


def _log(path: Path, found: Mapping[str, Any]) -> Log:
    arrays = {n: np.squeeze(v) for n, v in found.items() if isinstance(v, np.ndarray)}
    numbers = {n: v for n, v in arrays.items() if v.dtype.kind in "iufb" and v.ndim in (1, 2)}
    if not numbers:
        raise refusal(
            f"{path}: it has no array of numbers over time. It has {', '.join(found) or 'nothing'}."
        )
    size = _samples(numbers)
    names = next((_texts(found[key]) for key in _NAMES if key in found and _texts(found[key])), [])
    columns: dict[str, Array] = {}
    for name, values in numbers.items():
        if values.ndim == 1:
            columns[name] = values
            continue
        across = values.T if values.shape[0] != size and values.shape[1] == size else values
        labels = names if len(names) == across.shape[1] else range(across.shape[1])
        columns |= {f"{name}[{label}]": across[:, k] for k, label in enumerate(labels)}
    return log_of(path, columns)


def _samples(numbers: Mapping[str, Array]) -> int:
    """How many samples most arrays have; those of the time count, where there is one."""
    times = [len(v) for n, v in numbers.items() if v.ndim == 1 and is_time(n)]
    return times[0] if times else Counter(len(v) for v in numbers.values()).most_common(1)[0][0]


def _texts(value: Any) -> list[str]:
    items = value.tolist() if isinstance(value, np.ndarray) else value
    proper = isinstance(items, list | tuple) and all(isinstance(item, str) for item in items)
    return list(items) if proper else []
