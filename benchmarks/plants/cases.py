"""The cases: which error is planted beside which real log, and which half of them it is of.

    case = cases()[0]
    case.name                   # "go2_leg-gain_0.3"
    cases(draw=1)[0].name       # "go2_leg-gain_0.3/1", of another place and size

A case depends on its name alone. Its best model is that of the log, so that where a friction is
taken away its size is the log's, too.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

Half = Literal["to fit", "to tell", ""]

CONTROL: Final = "nothing"
"""The best model with nothing planted: what is said of it is the log's own."""
AS_GIVEN: Final = "as_given"
"""The model as its makers gave it."""

_GAINS = ("gain_0.3", "gain_0.5", "gain_2", "gain_3")
PLANTS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "go2_leg": (
            *("gain_0.3", "payload", "coulomb_friction", "gain_2", "encoder_offset", "base_tilt"),
            *("gain_0.5", "delay", "armature", "sign_flip", "gain_3", "encoder_gain"),
            *("torque_constant", "viscous_friction"),
        ),
        "xl330": (
            *("payload", "gain_0.5", "delay", "viscous_friction", "gain_3", "base_tilt"),
            *("encoder_gain", "gain_0.3", "armature", "encoder_offset", "gain_2", "sign_flip"),
            "torque_constant",
        ),
        "emps": (
            *("gain_2", "coulomb_friction", "payload", "gain_0.3", "viscous_friction", "delay"),
            *("gain_3", "torque_constant", "sign_flip", "gain_0.5", "encoder_gain"),
        ),
        "double_pendulum": (
            *("shoulder_1.2", "payload", "encoder_offset", "shoulder_0.85", "coulomb_friction"),
            *("base_tilt", "armature", "torque_constant", "delay", "sign_flip", "encoder_gain"),
        ),
    }
)
"""Log to the kinds of errors that are planted beside it; see `plants.kinds.KINDS`."""
SERVO_GAINS: Final = frozenset(_GAINS)
"""The kinds that are a servo's gain that nobody knew."""


@dataclass(frozen=True, kw_only=True)
class PlantedCase:
    """One log with one error.

    Attributes:
        log: name of the log.
        kind: of the error, or `nothing` or `as_given`.
        half: T is fitted on one half of the plants and told on the other; "" for what is neither.
        draw: which draw of places and sizes.
    """

    log: str
    kind: str
    half: Half
    draw: int = 0

    @property
    def name(self) -> str:
        """What it is called in results."""
        return f"{self.log}-{self.kind}{f'/{self.draw}' if self.draw else ''}"

    @property
    def seed(self) -> int:
        """Of its place and size."""
        return zlib.crc32(self.name.encode())

    @property
    def alone(self) -> bool:
        """Whether one model of the log's is taken by itself: gains of several differ in size."""
        return self.kind in SERVO_GAINS


def cases(*logs: str, draw: int = 0) -> list[PlantedCase]:
    """All plants of a draw, the logs in turns, then the models without any.

    Args:
        logs: names of logs; by default all.
        draw: which draw.
    """
    chosen = [log for log in PLANTS if not logs or log in logs]
    found = []
    for number in range(max(map(len, PLANTS.values()))):
        for log in chosen:
            if number < len(PLANTS[log]):
                # Kinds stand at other places of other logs, so that both halves have most kinds.
                half: Half = "to tell" if number % 2 else "to fit"
                found.append(PlantedCase(log=log, kind=PLANTS[log][number], half=half, draw=draw))
    if draw == 0:
        found += [PlantedCase(log=log, kind=CONTROL, half="") for log in chosen]
        found += [PlantedCase(log=log, kind=AS_GIVEN, half="") for log in chosen]
    return found
