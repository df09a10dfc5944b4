"""MJCF as text with the places of its elements, to change attributes and keep every other byte.

    document = Document(Path("scene.xml"))
    (joint,) = (node for node in document.nodes() if node.get("name") == "knee")
    document.set(joint, "frictionloss", "0.2")
    document.texts()                  # {Path("go2.xml"): b"..."}, of the files that changed

Elements are found by an XML parser, in included files too. What is written is the file's own bytes
with the values of attributes exchanged; nothing is serialised anew.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

_ATTRIBUTE = re.compile(rb"""\s+([^\s=/>]+)\s*=\s*("[^"]*"|'[^']*')""")
_NAME = re.compile(rb"<([^\s/>]+)")
_INDENT = re.compile(rb"(?:^|\n)([ \t]*)$")


@dataclass(eq=False, kw_only=True)
class Node:
    """One element of a file.

    Attributes:
        tag: its name.
        attributes: as the file has them.
        file: where it is.
        start, end: offsets of its start tag.
        stop: offset behind all of it.
        children: in order; those of an include are the included file's.
        parent: the element around it, or None.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    start: int
    end: int
    stop: int = 0
    children: list[Node] = field(default_factory=list)
    parent: Node | None = None

    def get(self, name: str) -> str | None:
        """The value of an attribute."""
        return self.attributes.get(name)

    def walk(self) -> Iterator[Node]:
        """It and all below it, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()

    def inside(self, *tags: str, through: tuple[str, ...] = ("frame", "include")) -> list[Node]:
        """The children of some kinds, also those that only a frame or an include parts from it."""
        found = []
        for child in self.children:
            if child.tag in tags:
                found.append(child)
            elif child.tag in through:
                found += child.inside(*tags, through=through)
        return found


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One change of a file.

    Attributes:
        node: the element that has the attribute, or beside or in which an element was put.
        attribute: its name; empty for a new element.
        was: its value in the file, or None where the file leaves it to defaults.
        now: its new value, or the text of the new element.
    """

    node: Node
    attribute: str
    was: str | None
    now: str


@dataclass(kw_only=True)
class _Change:
    """What becomes of a start tag."""

    tag: str | None = None
    attributes: dict[str, str] = field(default_factory=dict)
    dropped: set[str] = field(default_factory=set)


class Document:
    """A model's file with all that it includes.

    Args:
        path: the main file.

    Attributes:
        path: the same.
        root: its outermost element.
        files: the main file and the included ones, in the order in which they are read.
        includes: included file to the element that includes it.

    Raises:
        ValueError: a file is not well-formed.
        OSError: a file cannot be read.
    """

    def __init__(self, path: Path):
        self.path = path
        self._bytes: dict[Path, bytes] = {}
        self.includes: dict[Path, Node] = {}
        self.root = self._read(path)
        self._changes: dict[Node, _Change] = {}
        self._inserted: dict[Path, list[tuple[int, bytes]]] = {}
        self._new: list[Edit] = []

    @property
    def files(self) -> tuple[Path, ...]:
        """The files, the main one first."""
        return tuple(self._bytes)

    def nodes(self) -> Iterator[Node]:
        """All elements in the order of the text."""
        yield from self.root.walk()

    def set(self, node: Node, attribute: str, value: str) -> None:
        """Gives an attribute another value, or adds it."""
        self._changes.setdefault(node, _Change()).attributes[attribute] = value

    def drop(self, node: Node, *attributes: str) -> None:
        """Takes attributes away."""
        self._changes.setdefault(node, _Change()).dropped.update(attributes)

    def rename(self, node: Node, tag: str) -> None:
        """Gives an element another name."""
        self._changes.setdefault(node, _Change()).tag = tag

    def insert_after(self, node: Node, text: str) -> None:
        """Puts an element behind another, on a line of its own."""
        self._insert(node, node.stop, text, self._indent(node))

    def insert_into(self, node: Node, text: str) -> None:
        """Puts an element before all others of one that has some, on a line of its own."""
        first = next((child for child in node.children if child.file == node.file), node)
        self._insert(node, node.end, text, self._indent(first))

    def changed(self) -> tuple[Edit, ...]:
        """What was changed, in the order in which it was asked for."""
        edits = [
            Edit(node=node, attribute=name, was=node.get(name), now=value)
            for node, change in self._changes.items()
            for name, value in change.attributes.items()
        ]
        return (*edits, *self._new)

    def texts(self) -> dict[Path, bytes]:
        """The files that change, as they become."""
        pieces: dict[Path, list[tuple[int, int, bytes]]] = {}
        for node, change in self._changes.items():
            tag = self._bytes[node.file][node.start : node.end]
            own = pieces.setdefault(node.file, [])
            own.append((node.start, node.end, _tag(tag, change)))
            if change.tag is not None and node.stop > node.end:
                last = self._bytes[node.file].rindex(b"</", node.end, node.stop)
                own.append((last, node.stop, b"</" + change.tag.encode() + b">"))
        for file, inserted in self._inserted.items():
            for at, text in inserted:
                pieces.setdefault(file, []).append((at, at, text))
        found = {}
        for file, all_of_it in pieces.items():
            text = self._bytes[file]
            # From the end, so that offsets before it stay right.
            for start, end, new in sorted(all_of_it, key=lambda one: one[:2], reverse=True):
                text = text[:start] + new + text[end:]
            found[file] = text
        return found

    def _insert(self, node: Node, at: int, text: str, indent: bytes) -> None:
        text_of = self._bytes[node.file]
        line = b"\r\n" if b"\r\n" in text_of else b"\n"
        self._inserted.setdefault(node.file, []).append((at, line + indent + text.encode()))
        self._new.append(Edit(node=node, attribute="", was=None, now=text))

    def _indent(self, node: Node) -> bytes:
        found = _INDENT.search(self._bytes[node.file][: node.start])
        return found[1] if found else b""

    def _read(self, path: Path) -> Node:
        data = path.read_bytes()
        self._bytes[path] = data
        open_: list[Node] = []
        roots: list[Node] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            at = parser.CurrentByteIndex
            node = Node(
                tag=tag,
                attributes=attributes,
                file=path,
                start=at,
                end=_end_of_tag(data, at),
                parent=open_[-1] if open_ else None,
            )
            (open_[-1].children if open_ else roots).append(node)
            open_.append(node)

        def end(tag: str) -> None:
            node = open_.pop()
            closed = data[node.end - 2 : node.end] == b"/>"
            node.stop = node.end if closed else _end_of_tag(data, parser.CurrentByteIndex)

        parser = expat.ParserCreate("utf-8")  # as MuJoCo takes it, whatever it declares
        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            raise ValueError(f"{path}: {error}") from None
        (root,) = roots
        for node in list(root.walk()):
            file = node.get("file")
            if node.tag == "include" and file is not None:
                included = self.path.parent / file
                if included in self._bytes:
                    raise ValueError(f"{included} is included twice")
                self.includes[included] = node
                node.children = self._read(included).children
                for child in node.children:
                    child.parent = node
        return root


def _end_of_tag(data: bytes, start: int) -> int:
    """The offset behind the tag that begins at `start`; a > in quotes does not end it."""
    quote, at = b"", start
    while True:
        one = data[at : at + 1]
        if quote:
            quote = b"" if one == quote else quote
        elif one in (b'"', b"'"):
            quote = one
        elif one == b">":
            return at + 1
        at += 1


def _tag(text: bytes, change: _Change) -> bytes:
    """A start tag with other attributes; what stays, stays byte for byte."""
    name = _NAME.match(text)
    if name is None:
        raise ValueError(f"{text!r} is no start tag")
    found, at = [name[0]], name.end()
    if change.tag is not None:
        found = [b"<" + change.tag.encode()]
    missing = dict(change.attributes)
    for match in _ATTRIBUTE.finditer(text, at):
        own = match[1].decode()
        at = match.end()
        if own in missing:
            quote = match[2][:1]
            whole = match[0][: -len(match[2])]
            found.append(whole + quote + missing.pop(own).encode() + quote)
        elif own not in change.dropped:
            found.append(match[0])
    found += [f' {own}="{value}"'.encode() for own, value in missing.items()]
    return b"".join([*found, text[at:]])
