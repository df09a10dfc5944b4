"""A mended model as its user's own file, with other numbers in it.

    written = write_mended(given, mended, folder / "model.xml", taken)
    written.reason          # why MuJoCo wrote it anew instead, or ""

Included files and assets keep their names and places relative to the model. A file is written so
only where it compiles to the mended model; else, and for what is no MJCF file, MuJoCo writes it.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco

from walkerkit.gap.deliver.markup import Document, Edit
from walkerkit.gap.deliver.patch import differences, patch
from walkerkit.gap.deliver.versions import needed
from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import write_model
from walkerkit.gap.simulation.robot import Robot

RESERVED = ("diagnosis.json", "report.html", "actuators.json", "experiments.toml")
# Where a servo became a <general>, and where names are in the text of the model.
_UNLIKE = ("actuator_ctrlspec",)


@dataclass(frozen=True, kw_only=True)
class Written:
    """How a model was written.

    Attributes:
        reason: why it is not the user's file with other numbers; empty where it is.
        needs: what of it takes a newer MuJoCo than the user's file does, to the first version.
    """

    reason: str = ""
    needs: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """What actuators.json says of it."""
        return {
            "yours_but_for_the_numbers": not self.reason,
            "reason": self.reason or None,
            "needs_mujoco": dict(self.needs),
        }


@dataclass(frozen=True, kw_only=True)
class Patched:
    """A user's file with other numbers, and what it needs beside it.

    Attributes:
        main: its text.
        others: included files, relative to it, that change.
        files: files that stay, relative to it, and where they are.
        edits: what was changed.
    """

    main: bytes
    others: Mapping[Path, bytes]
    files: Mapping[Path, Path]
    edits: tuple[Edit, ...]


def write_mended(
    given: Robot, mended: Robot, path: Path, taken: dict[str, Path | str] | None = None
) -> Written:
    """Writes a mended robot's model.

    Args:
        given: the robot as it was read.
        mended: the robot with what was found.
        path: the file; what belongs to it goes into its folder.
        taken: names of assets that other models have put there; added to.

    Returns:
        How it was written.
    """
    taken = {} if taken is None else taken
    try:
        found = patched(given, mended)
        _check_names(found, path, taken)
    except ValueError as error:
        write_model(mended, path, taken)
        return Written(reason=one_line(error), needs={"model": mujoco.__version__})
    place(found, path)
    for name, source in found.files.items():
        if name.parent != Path():
            taken[name.name] = source
    return Written(needs=needed(found.edits))


def patched(given: Robot, mended: Robot, *, prefix: str = "") -> Patched:
    """The user's file with the numbers of a mended robot.

    Args:
        given: the robot as it was read from the file.
        mended: the robot with what was found.
        prefix: put before the names of included files that change.

    Raises:
        ValueError: it comes from no MJCF file, or the file cannot say what was found.
    """
    path = given.path
    if path is None:
        raise ValueError("the model was made by a function")
    document = Document(path)
    if document.root.tag != "mujoco":
        raise ValueError("the model is no MJCF file")
    patch(document, given, mended)
    edits, names = document.changed(), dict[Path, Path]()
    if prefix:
        names = _renamed(document, prefix)
    texts = document.texts()
    files = {_inside(file, path.parent): file for file in document.files[1:]}
    files |= {_inside(file, path.parent): file for file in assets(given.spec)}
    main = texts.pop(path, path.read_bytes())
    others = {_inside(names.get(file, file), path.parent): text for file, text in texts.items()}
    found = Patched(
        main=main,
        others=others,
        files={name: file for name, file in files.items() if name not in others},
        edits=edits,
    )
    _check_same(found, mended, path.name)
    return found


def _renamed(document: Document, prefix: str) -> dict[Path, Path]:
    """Has included files that change included under other names; returns these."""
    names: dict[Path, Path] = {}
    while True:
        new = {*document.texts()} - {*names, document.path}
        if not new:
            return names
        for file in new:
            names[file] = file.with_name(prefix + file.name)
            inside = _inside(names[file], document.path.parent)
            document.set(document.includes[file], "file", inside.as_posix())


def place(found: Patched, path: Path, *, link: bool = False) -> None:
    """Writes a file with all that it needs beside it.

    Args:
        found: the file.
        path: where to.
        link: make links to files that stay, instead of copies.
    """
    for name, file in found.files.items():
        target = path.parent / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if link:
            target.symlink_to(file.resolve())
        else:
            shutil.copyfile(file, target)
    for name, text in found.others.items():
        (path.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (path.parent / name).write_bytes(text)
    path.write_bytes(found.main)


def assets(spec: mujoco.MjSpec) -> Iterator[Path]:
    """The files of meshes, height fields, skins and textures."""
    shapes = [*spec.meshes, *spec.hfields, *spec.skins]
    named = [(one.file, spec.meshdir) for one in shapes]
    for texture in spec.textures:
        named += [(file, spec.texturedir) for file in (texture.file, *texture.cubefiles)]
    for file, folder in named:
        if file:
            yield Path(spec.modelfiledir) / folder / file


def _inside(file: Path, folder: Path) -> Path:
    """A file's place relative to the model's folder."""
    try:
        name = Path(*file.absolute().parts).relative_to(folder.absolute())
    except ValueError:
        name = Path("..")
    if ".." in name.parts:
        raise ValueError(f"its file {file} lies outside of its folder")
    return name


def _check_same(found: Patched, mended: Robot, name: str) -> None:
    """Raises ValueError where a file does not compile to what was mended."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        place(found, path, link=True)
        try:
            model = load_robot(path, allow_outside=True).model
        except InputError as error:
            raise ValueError(f"with the new numbers {error}") from None
    unlike = differences(model, mended.model, ignored=_UNLIKE)
    if unlike:
        raise ValueError(f"settings of the file keep {unlike[0]} from being changed")


def _check_names(found: Patched, path: Path, taken: Mapping[str, Path | str]) -> None:
    """Raises ValueError where a file would take the place of another one."""
    for name in (*found.files, *found.others):
        if name in (Path(path.name), *map(Path, RESERVED)):
            raise ValueError(f"its file {name} has the name of one of the result")
        target, source = path.parent / name, found.files.get(name)
        other = target.exists() and (source is None or target.read_bytes() != source.read_bytes())
        if other or (source is not None and taken.get(name.name, source) != source):
            raise ValueError(f"its file {name} has the name of another model's")
