"""An MJCF file and what it includes as text, changed in a few places and else kept byte for byte.

    text = MjcfText.read(Path("scene.xml"))
    motor = next(e for e in text.elements if e.tag == "motor")
    text.change(motor, tag="position", attributes={"kp": "60", "ctrlrange": None})
    text.write(Path("scene_servo.xml"))      # and beside it what it includes and has changed

Included files that have not changed are named as before, so the new file belongs into the folder of
the old one, unless that reads no other file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from walkerkit.gap.errors import InputError, one_line, refusal

_TAG = re.compile(rb"<[^\s/>]+(?:\s+[^\s=/>]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*\s*(/?)>")
_END = re.compile(rb"</[^>]*>")
_READS = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """One element.

    Attributes:
        tag: its name.
        attributes: as the text has them.
        file: where it is.
        start, stop: bytes of its start tag.
        closing: bytes of its end tag; None where its start tag is all of it.
        parents: elements around it, the outermost first; those of the including file too.
    """

    tag: str
    attributes: Mapping[str, str]
    file: Path
    start: int
    stop: int
    closing: tuple[int, int] | None
    parents: tuple[Element, ...]

    def within(self, tag: str) -> bool:
        """Whether it is somewhere in an element of this name."""
        return any(parent.tag == tag for parent in self.parents)


@dataclass(kw_only=True)
class _File:
    content: bytes
    edits: list[tuple[int, int, bytes]] = field(default_factory=list)

    def edited(self) -> bytes:
        content = self.content
        for start, stop, new in sorted(self.edits, key=lambda one: one[:2], reverse=True):
            content = content[:start] + new + content[stop:]
        return content


class MjcfText:
    """A model's text.

    Attributes:
        path: of the main file.
        elements: all of them, in the order in which MuJoCo meets them.
    """

    def __init__(self, path: Path):
        self.path = path
        self.elements: list[Element] = []
        self._files: dict[Path, _File] = {}

    @classmethod
    def read(cls, path: Path) -> MjcfText:
        """Reads a model and what it includes.

        Raises:
            InputError: a file cannot be read, or it is no MJCF.
        """
        text = cls(path)
        text.elements = list(text._elements(path, ()))
        if text.elements and text.elements[0].tag != "mujoco":
            raise refusal(
                f"{path}: its root is <{text.elements[0].tag}>, no MJCF. Save a URDF as MJCF "
                "first: mujoco.mj_saveLastXML after it was loaded."
            )
        return text

    def change(
        self, element: Element, *, attributes: Mapping[str, str | None], tag: str | None = None
    ) -> str:
        """Changes an element's name and attributes.

        Args:
            element: one of `elements`, changed once at most.
            attributes: name to the new value, None for one that is to go.
            tag: its new name.

        Returns:
            Its new start tag.
        """
        file = self._files[element.file]
        text = file.content[element.start : element.stop].decode()
        for name, value in attributes.items():
            there = re.search(rf"\s+{re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')", text)
            if value is None:
                text = text if there is None else text[: there.start()] + text[there.end() :]
            elif there is not None:
                text = f'{text[: there.start(1)]}"{value}"{text[there.end(1) :]}'
            else:
                end = re.search(r"\s*/?>$", text)
                place = len(text) - 1 if end is None else end.start()
                text = f'{text[:place]} {name}="{value}"{text[place:]}'
        if tag is not None:
            text = re.sub(r"^<[^\s/>]+", f"<{tag}", text)
            if element.closing is not None:
                file.edits.append((*element.closing, f"</{tag}>".encode()))
        file.edits.append((element.start, element.stop, text.encode()))
        return text

    def remove(self, element: Element) -> None:
        """Removes an element, and its line where that has nothing else."""
        file = self._files[element.file]
        stop = element.stop if element.closing is None else element.closing[1]
        before = re.search(rb"[ \t]*$", file.content[: element.start])
        start = element.start if before is None else before.start()
        alone = start == 0 or file.content[start - 1 : start] == b"\n"
        line = re.match(rb"[ \t]*\r?\n", file.content[stop:])
        if alone and line is not None:
            file.edits.append((start, stop + line.end(), b""))
        else:
            file.edits.append((element.start, stop, b""))

    def add(self, section: str, lines: Sequence[str]) -> None:
        """Adds elements at the end of a section below the root, made where it is missing."""
        found = [e for e in self.elements if e.tag == section and e.closing and len(e.parents) == 1]
        # The main file's own, or that of one it includes.
        own = [e for e in found if e.file == self.path] or found
        if own:
            closing = own[-1].closing
            place = closing[0] if closing else 0
            self._insert(own[-1].file, place, [f"  {line}" for line in lines])
            return
        root = self.elements[0]
        place = root.closing[0] if root.closing else root.stop
        inner = [f"<{section}>", *(f"  {line}" for line in lines), f"</{section}>"]
        self._insert(self.path, place, inner)

    def write(self, path: Path) -> list[Path]:
        """Writes the model, and beside it those of its included files that have changed.

        Args:
            path: of the main file.

        Returns:
            The files written, the main one first.

        Raises:
            InputError: it would lie where the files that it reads are not, or on one of its own.
        """
        self._check_place(path)
        renamed = {
            file: f"{path.stem}_{file.name.removeprefix(f'{self.path.stem}_')}"
            for file in self._changed()
            if file != self.path
        }
        for element in self.elements:
            target = self._included(element)
            if target in renamed:
                self.change(element, attributes={"file": renamed[target]})
        written = []
        for file, content in self._files.items():
            if file == self.path or file in renamed:
                place = path if file == self.path else path.parent / renamed[file]
                try:
                    place.write_bytes(content.edited())
                except OSError as error:
                    raise refusal(
                        f"{place}: cannot be written ({error.strerror}). Give another --out."
                    ) from None
                written.append(place)
        return written

    def _changed(self) -> set[Path]:
        """Files that are changed, and those that include them."""
        changed = {file for file, content in self._files.items() if content.edits}
        for element in reversed(self.elements):
            if self._included(element) in changed:
                changed.add(element.file)
        return changed

    def _check_place(self, path: Path) -> None:
        if path.resolve() in {file.resolve() for file in self._files}:
            raise refusal(f"{path}: this is the model itself. Give --out a name of its own.")
        if not path.parent.is_dir():
            raise refusal(f"{path}: the folder {path.parent} does not exist. Make it.")
        changed = self._changed()
        reads = [
            element
            for element in self.elements
            if any(name in element.attributes for name in _READS)
            and self._included(element) not in changed
        ]
        if reads and path.parent.resolve() != self.path.parent.resolve():
            raise refusal(
                f"{path}: the model reads {reads[0].attributes.get('file', 'files')!r} beside "
                f"{self.path}. Give --out a name in the folder '{self.path.parent.resolve()}'."
            )

    def _included(self, element: Element) -> Path | None:
        if element.tag != "include" or "file" not in element.attributes:
            return None
        return self.path.parent / element.attributes["file"]

    def _insert(self, file: Path, place: int, lines: Sequence[str]) -> None:
        content = self._files[file].content
        newline = b"\r\n" if b"\r\n" in content else b"\n"
        begin = content.rfind(b"\n", 0, place) + 1
        indent = content[begin:place]
        if indent.strip():
            begin, indent = place, b""
        text = b"".join(indent + b"  " + line.encode() + newline for line in lines)
        if begin == place and indent == b"" and content[place - 1 : place] != b"\n":
            text = newline + text
        self._files[file].edits.append((begin, begin, text))

    def _elements(self, path: Path, around: tuple[Element, ...]) -> Iterator[Element]:
        """The elements of a file; those of an included one in the place of its root."""
        if path in self._files:
            raise refusal(f"{path}: it is included twice. Write the model without that.")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise refusal(f"{path}: cannot be opened: {error.strerror}. Check the path.") from None
        self._files[path] = _File(content=content)
        for element in _parsed(path, content, around):
            yield element
            included = self._included(element)
            if included is not None:
                yield from self._elements(included, element.parents)


def _parsed(path: Path, content: bytes, around: tuple[Element, ...]) -> list[Element]:
    """The elements of one file, in its order; the root of an included one is left out."""
    starts: list[tuple[str, dict[str, str], int, int]] = []
    ends: dict[int, tuple[int, int] | None] = {}
    stack: list[int] = []
    depth_parent: list[tuple[int, ...]] = []
    parser = expat.ParserCreate("utf-8")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        start = parser.CurrentByteIndex
        tag_text = _TAG.match(content, start)
        if tag_text is None:
            raise refusal(f"{path}: the tag <{tag}> at byte {start} cannot be read. Mend it.")
        depth_parent.append(tuple(stack))
        stack.append(len(starts))
        starts.append((tag, attributes, start, tag_text.end()))

    def end(_: str) -> None:
        number = stack.pop()
        closing = _END.match(content, parser.CurrentByteIndex)
        ends[number] = None if closing is None else closing.span()

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(
            f"{path}: the model cannot be read: {one_line(error)}. Mend the MJCF until MuJoCo "
            "loads it."
        ) from None
    made: list[Element] = []
    for number, (tag, attributes, start, stop) in enumerate(starts):
        parents = [made[parent] for parent in depth_parent[number]]
        made.append(
            Element(
                tag=tag,
                attributes=attributes,
                file=path,
                start=start,
                stop=stop,
                closing=ends[number],
                parents=(*around, *(parents[1:] if around else parents)),
            )
        )
    return made[1:] if around else made
