"""A robot that floats, hung up by its root body for an experiment on its joints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def hang_up(walker: Any, frame: Any, height: float) -> None:
    """Holds the root of a robot in the air; one that does not float stays as it is.

    MuJoCo lets neighbouring bodies overlap, unless the first of them is fixed to the world: then a
    hip would collide with the trunk that it is mounted in. So those pairs are excluded here.

    Args:
        walker: a walker with its root joints created.
        frame: what `arena.attach(walker)` returned.
        height: of the root [m].
    """
    if frame.freejoint is None:
        return
    frame.freejoint.remove()
    frame.pos = [0.0, 0.0, height]
    contact = walker.mjcf_model.contact
    for root in walker.mjcf_model.worldbody.body:
        fixed = list(_rigid(root))
        mounted = [child for part in fixed for child in part.body if child.joint]
        for neighbour in (part for child in mounted for part in _rigid(child)):
            for part in fixed:
                contact.add("exclude", body1=part, body2=neighbour)


def _rigid(body: Any) -> Iterator[Any]:
    """A body and all that is fixed to it."""
    yield body
    for child in body.body:
        if not child.joint:
            yield from _rigid(child)
