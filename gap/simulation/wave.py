"""What comes back with the pose of a joint: A sin(N q + φ)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WaveForm = Literal["pose", "friction", "effort"]


@dataclass(frozen=True, kw_only=True)
class Wave:
    """A wave over the positions of a joint.

    Attributes:
        form: what the wave is: an effort of the pose alone, dry friction against the motion, or a
            factor of the drive's effort.
        periods: N, per radian or metre of the joint.
        amplitude: A [N·m; N], without unit as a factor of the effort.
        phase: φ [rad].
        mean: of dry friction, the constant part beside the wave [N·m; N].
    """

    form: WaveForm
    periods: float
    amplitude: float
    phase: float
    mean: float = 0.0
