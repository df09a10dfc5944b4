"""What is compared: one measured signal of a joint, or of the base of a robot that floats.

Channel(joint="knee", signal="effort").measured(recording)
Channel(joint="base", signal="orientation_y").quantity       # "base_orientation"
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings import base_state
from walkerkit.gap.recordings.recording import Recording

FloatArray = NDArray[np.float64]

_UNITS = {  # on a hinge, on a slide joint
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "effort": ("N·m", "N"),
    "voltage": ("V", "V"),  # of a target
    "base_position": ("m", "m"),
    "base_orientation": ("rad", "rad"),
    "base_angular_velocity": ("rad/s", "rad/s"),
}


@dataclass(frozen=True, kw_only=True, order=True)
class Channel:
    """One measured signal.

    Attributes:
        joint: name of the joint, or `base`.
        signal: `position`, `velocity` or `effort`; of the base one of
            `recordings.base_state.SIGNALS`.
    """

    joint: str
    signal: str

    @property
    def of_base(self) -> bool:
        """Whether it is the base's, and no joint's that happens to be called so."""
        return self.joint == base_state.BASE and self.signal in base_state.SIGNALS

    @property
    def quantity(self) -> str:
        """The signal, or such as `base_orientation` for all axes of the base's."""
        return f"base_{self.signal.rpartition('_')[0]}" if self.of_base else self.signal

    def unit(self, *, slide: bool = False) -> str:
        """Its unit, on a hinge or on a slide joint."""
        return _UNITS[self.quantity][slide]

    def measured(self, recording: Recording) -> FloatArray | None:
        """(T,) samples of a recording, or None where it does not have them."""
        if self.of_base:
            return base_state.base_signal(recording, self.signal)
        return recording.signal(self.joint, self.signal)


def base_channels(recordings: Sequence[Recording]) -> tuple[Channel, ...]:
    """The base's channels, none where no recording has its pose."""
    found = {signal for recording in recordings for signal in base_state.compared(recording)}
    return tuple(Channel(joint=base_state.BASE, signal=s) for s in base_state.SIGNALS if s in found)


def estimate_error(recordings: Sequence[Recording], channel: Channel) -> float:
    """Standard deviation of a channel of the base for its having been estimated, 0 for none."""
    name = f"{channel.joint}/{channel.signal}"
    stds = [r.errors[name] for r in recordings if channel.of_base and name in r.errors]
    return float(np.sqrt(np.mean(np.concatenate(stds) ** 2))) if stds else 0.0
