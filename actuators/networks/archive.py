"""Networks as `.npz` files: plain arrays, never pickled objects.

    write(path, "walkerkit.mlp", {"weight_0": weight})
    archive = read(path, "walkerkit.mlp")
    weight = archive.floats("weight_0")
    archive.finish()  # nothing may be left over

Every file has two arrays of its own: `format`, a string that says which network it is, and
`version`, an integer. Whatever is wrong with a file is a `ValueError` that names the file and the
array, never an exception of the formats beneath.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.npz import open_npz

FloatArray = NDArray[np.float64]

VERSION = 1
_MOST_BYTES = 2**30  # of all arrays, unpacked
_LARGEST_FLOAT = 8  # bytes, what float64 holds without loss


class Archive:
    """The arrays of one file, each to be taken once."""

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]):
        self._path = path
        self._left = dict(arrays)

    def floats(self, name: str) -> FloatArray:
        """Takes an array of floating-point numbers.

        Raises:
            ValueError: The array is missing, or of another dtype.
        """
        array = self._take(name)
        if array.dtype.kind != "f" or array.dtype.itemsize > _LARGEST_FLOAT:
            raise ValueError(
                f"{self._path}: array `{name}` has dtype {array.dtype}, expected float64 or "
                "float32: convert it with .astype(float)"
            )
        return array.astype(np.float64)

    def names(self, name: str) -> tuple[str, ...]:
        """Takes a one-dimensional array of strings.

        Raises:
            ValueError: The array is missing, or something else.
        """
        array = self._take(name)
        if array.dtype.kind != "U" or array.ndim != 1:
            raise ValueError(
                f"{self._path}: array `{name}` has dtype {array.dtype} and shape {array.shape}, "
                "expected strings in one dimension: save it as np.array(['elu', 'identity'])"
            )
        return tuple(str(entry) for entry in array)

    def count(self, prefix: str) -> int:
        """How many of `<prefix>0`, `<prefix>1`, … there are."""
        count = 0
        while f"{prefix}{count}" in self._left:
            count += 1
        return count

    def finish(self) -> None:
        """Refuses what nobody took.

        Raises:
            ValueError: An array is left over.
        """
        if self._left:
            raise ValueError(
                f"{self._path}: this network has no use for {_listed(self._left)}: remove what is "
                "not part of it, or give `activations` one name for each layer"
            )

    def take_header(self, kind: str) -> None:
        """Takes `format` and `version`.

        Raises:
            ValueError: The file holds another kind of network, or a later version of it.
        """
        found = self._take("format")
        if found.shape != () or found.item() != kind:
            raise ValueError(
                f"{self._path}: array `format` is {found.tolist()!r}, expected {kind!r}: load it "
                "as the network that it names"
            )
        version = self._take("version")
        if version.dtype.kind not in "iu" or version.shape != ():
            raise ValueError(
                f"{self._path}: array `version` is {version.tolist()!r}, expected one integer: "
                f"save np.array({VERSION})"
            )
        if version != VERSION:
            raise ValueError(
                f"{self._path}: array `version` is {version}, this walkerkit reads {VERSION}: "
                "upgrade walkerkit, or save the network again"
            )

    def _take(self, name: str) -> NDArray[Any]:
        if name not in self._left:
            closest = difflib.get_close_matches(name, self._left, n=1, cutoff=0.6)
            raise ValueError(
                f"{self._path}: array `{name}` is missing"
                + (f" (is {_quoted(closest[0])} meant?)" if closest else "")
                + f"; there is {_listed(self._left)}: save the network with its `save`"
            )
        return self._left.pop(name)


def read(path: Path | str, kind: str) -> Archive:
    """Reads all arrays of a file, with its `format` and `version` already checked.

    Args:
        path: the `.npz` file.
        kind: what `format` has to be.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is not a complete `.npz` of plain arrays of this kind.
    """
    path = Path(path)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise FileNotFoundError(
            f"the network file {path} {what}: give the path of an .npz (relative paths start at "
            f"{Path.cwd()})"
        )
    archive = Archive(path, _arrays(path))
    archive.take_header(kind)
    return archive


def write(path: Path | str, kind: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Writes a file that `read` reads; the same arrays give the same bytes.

    Raises:
        FileNotFoundError: The folder does not exist.
        ValueError: The name does not end in `.npz`.
    """
    path = check_npz(path)
    everything: dict[str, Any] = {"format": np.array(kind), "version": np.array(VERSION), **arrays}
    with path.open("wb") as file:
        np.savez(file, **everything)


def check_npz(path: Path | str) -> Path:
    """Returns `path` where a network can be written.

    Raises:
        FileNotFoundError: The folder does not exist.
        ValueError: The name does not end in `.npz`.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"networks are saved as .npz, got {path}: use {path.with_suffix('.npz')}")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot save {path}: make the folder {path.parent.absolute()}")
    return path


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of an .npz; a broken file meets parsers that raise almost anything."""
    name = None
    arrays: dict[str, NDArray[Any]] = {}
    try:
        with path.open("rb") as stream:
            file = open_npz(stream, most_bytes=_MOST_BYTES)
            if any(entry.endswith("data.pkl") for entry in file.others):
                raise ValueError("a PyTorch file, which convert_torch makes into an .npz")
            if file.others:
                name = file.others[0]
                raise ValueError("not an array")
            for name in file.names:
                arrays[name] = file[name]
    except Exception as error:
        where = "it" if name is None else f"array {_quoted(name)}"
        raise ValueError(
            f"{path}: {where} cannot be read ({error}): the file should be a complete .npz of "
            "plain arrays (nothing pickled); save the network again"
        ) from error
    return arrays


def _listed(names: Mapping[str, object]) -> str:
    return ", ".join(map(_quoted, names)) or "nothing else"


def _quoted(name: str) -> str:
    """The name of an array on one line; whoever wrote the file may have put anything into it."""
    return f"`{name if name.isprintable() else repr(name)[1:-1]}`"
