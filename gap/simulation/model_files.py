"""What a model file may make MuJoCo read and build, looked at before MuJoCo is asked.

    check_model_files(Path("leg.xml"))                       # InputError, or nothing
    check_model_files(Path("leg.xml"), allow_outside=True)   # its files may lie anywhere

A model from somebody else can include any file of the machine, copy it into a result as an asset,
and ask for more memory than there is. So its files have to lie in its folder or below, a declared
entity is refused, and numbers that size what is built are bounded.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from walkerkit.gap.errors import InputError, one_line

_MEND = "Mend the MJCF until MuJoCo loads it."
_MOST_BYTES = 2**26  # of a model's text
_MOST_ASSET_BYTES = 2**30
_MOST_FILES = 256  # included, or attached
_DECLARATION = re.compile(rb"<!(ENTITY|DOCTYPE)", re.IGNORECASE)
_ASSET = re.compile(r"file(name|right|left|up|down|front|back)?")
_MOST = {
    **dict.fromkeys(("nrow", "ncol", "width", "height"), 2**13),
    **dict.fromkeys(("nsample", "actdim", "maxhullvert"), 10**5),
    **dict.fromkeys(("nconmax", "njmax", "nstack", "nuserdata", "nkey", "size"), 10**7),
}
_MOST_USER = 10**4  # numbers of a user's that each element has
_MOST_COPIES = 10**4
_MEMORY = re.compile(r"\s*(-?\d+)\s*([KMGTPE]?)\s*", re.IGNORECASE)
_MOST_MEMORY = 2**33
_DIRECTORIES = ("meshdir", "texturedir", "assetdir")


def check_model_files(path: Path, *, allow_outside: bool = False) -> None:
    """Looks at a model and at all that it includes or attaches.

    Args:
        path: an MJCF or URDF file.
        allow_outside: whether files may lie outside of its folder.

    Raises:
        InputError: one of the files cannot be read, is too large, declares an entity, lies outside
            of the model's folder, or asks for something that is too large.
    """
    _Check(path, allow_outside).run()


class _Check:
    def __init__(self, path: Path, allow_outside: bool):
        self._path = path
        self._allow_outside = allow_outside
        self._seen: set[Path] = set()
        # A model may be a link into a folder where its assets are.
        self._homes = [path.parent.resolve(), path.resolve().parent]

    def run(self) -> None:
        self._file(self._path, self._path.parent)

    def _file(self, path: Path, folder: Path) -> None:
        """Checks one file whose own files are relative to `folder`."""
        if path in self._seen:
            return  # MuJoCo refuses a file that includes itself
        self._seen.add(path)
        if len(self._seen) > _MOST_FILES:
            raise InputError(
                f"{self._path}: it includes more than {_MOST_FILES} files. Write it with fewer."
            )
        if self._path != path and not path.is_file():
            return  # MuJoCo says which it misses
        root = self._parsed(path)
        compilers = [*root.iter("compiler")]
        strip = root.tag == "robot"  # a URDF's paths are those of another machine
        for compiler in compilers:
            if compiler.get("strippath") is not None:
                strip = compiler.get("strippath") == "true"
        folders = {
            str(compiler.get(name))
            for compiler in compilers
            for name in _DIRECTORIES
            if compiler.get(name) is not None
        }
        for element, copies in _elements(root, 1):
            self._numbers(path, element, copies)
            for name, value in element.attrib.items():
                if not _ASSET.fullmatch(name):
                    continue
                if element.tag in ("include", "model"):
                    self._inside(path, folder, value)
                    attached = folder / value
                    own = attached.parent if element.tag == "model" else folder
                    self._file(attached, own)
                    continue
                file = re.split(r"[/\\]", value)[-1] if strip else value
                for within in sorted({"", *folders}):
                    self._inside(path, folder / within, file)

    def _parsed(self, path: Path) -> ElementTree.Element:
        try:
            size = path.stat().st_size
            content = path.read_bytes() if size <= _MOST_BYTES else b""
        except OSError as error:
            raise InputError(
                f"{path}: cannot be opened: {error.strerror}. Check the path."
            ) from None
        if size > _MOST_BYTES:
            raise InputError(
                f"{path}: a model of {size} bytes is more than the {_MOST_BYTES} that are read. "
                "Put its meshes in files of their own."
            )
        declared = _DECLARATION.search(content)
        if declared:
            line = content[: declared.start()].count(b"\n") + 1
            raise InputError(
                f"{path}: line {line} declares {declared[0].decode()!r}, and entities are not "
                "read. Write what it stands for."
            )
        try:
            # MuJoCo takes every file for UTF-8, whatever it declares.
            return ElementTree.fromstring(content, ElementTree.XMLParser(encoding="utf-8"))
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise InputError(
                f"{path}: the model does not compile: {one_line(error)}. {_MEND}"
            ) from None

    def _inside(self, path: Path, folder: Path, file: str) -> None:
        if not file or self._allow_outside:
            return
        wanted = Path.cwd() / folder / file
        try:
            real = wanted.resolve()
            size = real.stat().st_size if real.is_file() else 0
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError(
                f"{path}: file {file!r} cannot be used: {one_line(error)}. Name another."
            ) from None
        home = os.path.normpath(Path.cwd() / self._path.parent)
        # Neither by its name nor by where a link leads.
        if not Path(os.path.normpath(wanted)).is_relative_to(home) or not any(
            real.is_relative_to(home) for home in self._homes
        ):
            raise InputError(
                f"{path}: file {file!r} lies outside of the model's folder "
                f"{self._path.parent or '.'}. Put it there, or pass --allow-outside "
                "(allow_outside=True) if you trust the model."
            )
        if size > _MOST_ASSET_BYTES:
            raise InputError(
                f"{path}: file {file!r} has {size} bytes, more than the {_MOST_ASSET_BYTES} that "
                "are read. Simplify it."
            )

    def _numbers(self, path: Path, element: ElementTree.Element, copies: int) -> None:
        if copies > _MOST_COPIES:
            raise self._too_much(path, element, "count", f"makes {copies} copies", _MOST_COPIES)
        for name, value in element.attrib.items():
            most = _MOST_USER if name.startswith("nuser_") else _MOST.get(name)
            if name == "size" and element.tag not in ("numeric", "text", "tuple"):
                continue
            if most is not None and _integer(value) > most:
                raise self._too_much(path, element, name, f"is {value[:40]}", most)
            if name == "memory":
                found = _MEMORY.fullmatch(value)
                power = "KMGTPE".find(found[2].upper()) + 1 if found and found[2] else 0
                if found and int(found[1]) * 1024**power > _MOST_MEMORY:
                    raise self._too_much(path, element, name, f"is {value[:40]}", "8G")

    def _too_much(
        self, path: Path, element: ElementTree.Element, name: str, what: str, most: object
    ) -> InputError:
        return InputError(
            f"{path}: `{name}` of <{element.tag}> {what}, and at most {most} is built. "
            "Give a smaller number."
        )


def _elements(
    element: ElementTree.Element, copies: int
) -> Iterator[tuple[ElementTree.Element, int]]:
    """All elements, and how many copies of each there will be."""
    stack = [(element, copies)]
    while stack:
        one, times = stack.pop()
        count = 1
        if one.tag in ("replicate", "composite", "flexcomp"):
            for number in one.get("count", "1").split():
                count *= max(1, _integer(number))
        times *= count
        yield one, times
        stack.extend((child, times) for child in one)


def _integer(text: str) -> int:
    """The largest whole number that MuJoCo could read there; 0 where it would read none."""
    try:
        return int(float(text.split()[0])) if len(text) < 400 else 0
    except (ValueError, OverflowError, IndexError):
        return 0
