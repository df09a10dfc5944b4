"""Opening `.npz` files of strangers: nothing unpickled, and no size believed before it is checked.

    with path.open("rb") as stream:
        archive = open_npz(stream, most_bytes=2**28)
        weight = archive["weight_0"]

A few kilobytes of zip can declare terabytes. The sizes in the archive's directory are added up
before anything is extracted, and each array's header has to ask for no more than its entry holds.
"""

from __future__ import annotations

import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

_SUFFIX = ".npy"
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_ZIP = b"PK"


class NpzArchive:
    """The arrays of an archive whose declared sizes are bearable.

    Args:
        archive: the open zip.

    Attributes:
        names: names of the arrays, in the file's order, with what is there twice twice.
        others: names of what is no array.
    """

    def __init__(self, archive: zipfile.ZipFile):
        self._archive = archive
        infos = archive.infolist()
        arrays = [info for info in infos if info.filename.endswith(_SUFFIX)]
        self._entries = {info.filename.removesuffix(_SUFFIX): info for info in arrays}
        self.names = tuple(info.filename.removesuffix(_SUFFIX) for info in arrays)
        self.others = tuple(i.filename for i in infos if not i.filename.endswith(_SUFFIX))

    @property
    def size(self) -> int:
        """Bytes that the arrays say they have, unpacked."""
        return sum(info.file_size for info in self._archive.infolist())

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Reads an array.

        Raises:
            ValueError: it is pickled, damaged, or its header asks for more than there is.
        """
        entry = self._entries[name]
        with self._archive.open(entry) as file:
            self._check_header(file, entry)
        with self._archive.open(entry) as file:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
            return array

    def _check_header(self, file: Any, entry: zipfile.ZipInfo) -> None:
        version = np.lib.format.read_magic(file)
        if version not in _HEADERS:
            raise ValueError(f"its header is of version {version}, which only structures need")
        shape, _, dtype = _HEADERS[version](file)
        wanted = dtype.itemsize
        for length in shape:
            wanted *= int(length)
        if not dtype.hasobject and wanted > entry.file_size:
            raise ValueError(f"its header asks for {wanted} bytes, and there are {entry.file_size}")


def open_npz(file: BinaryIO, *, most_bytes: int) -> NpzArchive:
    """Looks at the directory of an archive.

    Args:
        file: the file, which has to stay open while arrays are read.
        most_bytes: that its arrays may have together, unpacked.

    Raises:
        ValueError: it is no archive of arrays, or one that unpacks to more.
    """
    if file.read(len(_ZIP)) != _ZIP:
        file.seek(0)
        bare = file.read(6) == b"\x93NUMPY"
        raise ValueError(
            "it holds one bare array, not several with names, as numpy.savez writes them"
            if bare
            else "it is no .npz archive, as numpy.savez writes them"
        )
    file.seek(0)
    found = NpzArchive(zipfile.ZipFile(file))
    if found.size > most_bytes:
        raise ValueError(
            f"its arrays unpack to {found.size} bytes, more than the {most_bytes} that are read"
        )
    return found
