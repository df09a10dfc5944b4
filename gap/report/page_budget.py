"""What a report draws, as coarse as it must be to have room in a page of so many bytes.

    data = fitted(diagnosis, traces, room=900_000)    # for `html.page`, and what was left out

The robot that moves is given room first, then the signals; both get coarser before any recording is
left out, the fitted ones first.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from walkerkit.gap.report.diagnosis import Diagnosis, Trace
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.html import embedded
from walkerkit.gap.report.motion import Motion
from walkerkit.gap.report.samples import POINTS, packed
from walkerkit.gap.report.scene import frames, scene

_OF_MOTION = 0.45  # of the room, at most
_COARSER = ((8000, 1), (4000, 1), (2000, 1), (1000, 2), (500, 3))  # vertices, frames to one
_LEAST_POINTS = 150
_SPARE = 0.95  # of the room; how well fewer samples pack is a guess


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """What has room.

    Attributes:
        data: `scenes` where a robot moves, and `traces`, as `embedded` has them.
        points: about how many samples a signal is drawn with, where that is fewer than usual; 0
            where it is not.
        traces: how many signals are drawn.
        motions: how many recordings the robot moves in.
    """

    data: dict[str, str]
    points: int
    traces: int
    motions: int


def fitted(diagnosis: Diagnosis, traces: Sequence[Trace], room: int) -> Fitted:
    """Makes what is drawn fit.

    Args:
        diagnosis: the result.
        traces: its signals, in their order on the page.
        room: bytes.
    """
    mended = bool(diagnosis.effects)
    moving, motions = _moving(diagnosis.motions, int(_OF_MOTION * room), mended=mended)
    drawn, points, count = _signals(diagnosis, traces, room - len(moving), mended=mended)
    data = {"scenes": moving} if motions else {}
    if count:
        data["traces"] = drawn
    fewer = points if points < POINTS and any(t.time.size > points for t in traces) else 0
    return Fitted(data=data, points=fewer, traces=count, motions=motions)


def floor(diagnosis: Diagnosis, trace: Trace) -> GapSize | None:
    """The gap whose noise floor is drawn with a signal, or None."""
    return diagnosis.gap.joints.get(trace.joint) if trace.signal == "position" else None


def _moving(motions: Sequence[Motion], room: int, *, mended: bool) -> tuple[str, int]:
    """The scenes with as many motions as have room, and how many these are."""
    kept = list(motions)
    while kept:
        for vertices, nth in _COARSER:
            found = embedded(_scenes(kept, vertices, nth, mended=mended))
            if len(found) <= room:
                return found, len(kept)
        kept = kept[: min(len(kept) - 1, int(_SPARE * len(kept) * room / len(found)))]
    return "", 0


def _scenes(motions: Sequence[Motion], vertices: int, nth: int, *, mended: bool) -> dict[str, Any]:
    """Every scene once, however many models are drawn alike."""
    scenes: dict[str, int] = {}
    models: dict[int, int] = {}
    for motion in motions:
        if id(motion.model) not in models:
            text = json.dumps(scene(motion.model, vertices=vertices))
            models[id(motion.model)] = scenes.setdefault(text, len(scenes))
    return {
        "scenes": [json.loads(text) for text in scenes],
        "motions": [
            frames(one.every(nth), models[id(one.model)], mended=mended) for one in motions
        ],
    }


def _signals(
    diagnosis: Diagnosis, traces: Sequence[Trace], room: int, *, mended: bool
) -> tuple[str, int, int]:
    """As many signals as have room, about how many samples each has, and how many they are."""
    kept, points = list(traces), POINTS
    while kept:
        found = embedded(
            [packed(t, floor(diagnosis, t), mended=mended, points=points) for t in kept]
        )
        if len(found) <= room:
            return found, points, len(kept)
        share = max(0.0, _SPARE * room / len(found))
        if points > _LEAST_POINTS:
            longest = max(min(points, trace.time.size) for trace in kept)
            points = max(_LEAST_POINTS, min(points - 1, int(share * longest)))
        else:
            kept = kept[: min(len(kept) - 1, int(share * len(kept)))]
    return "", points, 0
