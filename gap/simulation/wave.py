"""What comes back with the pose of a joint: A sin(N q + φ)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WaveForm = Literal["pose", "friction", "effort", "position"]


@dataclass(frozen=True, kw_only=True)
class Wave:
    """A wave over the positions of a joint.

    Attributes:
        form: what the wave is: an effort of the pose alone, dry friction against the motion, a
            factor of the drive's effort, or an error of the logged position.
        periods: N, per radian or metre of the joint.
        amplitude: A [N·m; N], without unit as a factor of the effort, of a position [rad; m].
        phase: φ [rad].
        mean: of dry friction, the constant part beside the wave [N·m; N].
    """

    form: WaveForm
    periods: float
    amplitude: float
    phase: float
    mean: float = 0.0
