"""What a rehearsal robot has and its model lacks, for the workflow to find.

    HiddenEffect(effect="coulomb_friction", joints=("calf",), values={"frictionloss": 0.6})
    HiddenEffect(
        effect="viscous_friction",
        joints=("hip", "calf"),
        values={"hip/damping": 0.3, "calf/damping": 0.1},
    )
    HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 0.008})
    HiddenEffect(effect="payload", bodies=("calf",), values={"mass": 0.2})

`HIDEABLE` lists the effects with their parameters. A value is given once for all of the effect's
joints or bodies, or for each as `<joint>/<parameter>`. `joints=("*",)` means every joint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest


@dataclass(frozen=True, kw_only=True)
class HiddenParameter:
    """One number of an effect.

    Attributes:
        name: its key in `HiddenEffect.values`.
        unit: its unit on a hinge; on a slide joint read m for rad and N for N·m.
        least: smallest value that makes sense.
        exclusive: whether `least` itself does not.
    """

    name: str
    unit: str
    least: float = -math.inf
    exclusive: bool = False


@dataclass(frozen=True, kw_only=True)
class Hideable:
    """An effect that the rehearsal robot can have.

    Attributes:
        on: what has it: joints, bodies, or the whole world.
        parameters: its numbers.
    """

    on: Literal["joints", "bodies", "world"]
    parameters: tuple[HiddenParameter, ...]


def _joint_effect(
    name: str, unit: str, least: float = -math.inf, *, exclusive: bool = False
) -> Hideable:
    parameter = HiddenParameter(name=name, unit=unit, least=least, exclusive=exclusive)
    return Hideable(on="joints", parameters=(parameter,))


HIDEABLE: Final[Mapping[str, Hideable]] = MappingProxyType(
    {
        "viscous_friction": _joint_effect("damping", "N·m·s/rad", 0.0),
        "coulomb_friction": _joint_effect("frictionloss", "N·m", 0.0),
        "armature": _joint_effect("armature", "kg·m²", 0.0),
        "command_delay": _joint_effect("delay", "s", 0.0),
        "sensor_delay": _joint_effect("delay", "s", 0.0),
        "position_gain": _joint_effect("delta_kp", "N·m/rad"),
        "velocity_gain": _joint_effect("delta_kd", "N·m·s/rad"),
        "torque_constant": _joint_effect("alpha", "", -1.0, exclusive=True),
        "effort_limit": _joint_effect("forcerange", "N·m", 0.0, exclusive=True),
        "payload": Hideable(
            on="bodies", parameters=(HiddenParameter(name="mass", unit="kg", least=0.0),)
        ),
        "base_tilt": Hideable(
            on="world",
            parameters=(
                HiddenParameter(name="roll", unit="rad"),
                HiddenParameter(name="pitch", unit="rad"),
            ),
        ),
        "encoder_offset": _joint_effect("offset", "rad"),
        "torque_bias": _joint_effect("bias", "N·m"),
        "parallel_spring": Hideable(
            on="joints",
            parameters=(
                HiddenParameter(name="stiffness", unit="N·m/rad", least=0.0),
                HiddenParameter(name="springref", unit="rad"),
            ),
        ),
    }
)
"""The effects that can be hidden, by their names in the catalogue.

`delta_kp` and `delta_kd` are added to the drive's gains, `alpha` is the torque constant's relative
error, `forcerange` the drive's limit to both sides, `offset` what the encoder reads too much,
`roll` and `pitch` the base's rotation about the world's x, then y.
"""


@dataclass(frozen=True, kw_only=True)
class HiddenEffect:
    """An effect with its place and size.

    Attributes:
        effect: name from `HIDEABLE`.
        joints: the joints that have it, or ("*",) for all; empty unless it is a joint's effect.
        bodies: the bodies that have it; empty unless it is a body's effect.
        values: `<parameter>` or `<joint or body>/<parameter>` to value, read-only.

    Raises:
        InputError: an effect, place or value that makes no sense.
    """

    effect: str
    joints: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        if self.effect not in HIDEABLE:
            raise InputError(
                f"effect {self.effect!r} cannot be hidden{closest(self.effect, HIDEABLE)}; "
                f"choose from {', '.join(HIDEABLE)}"
            )
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "bodies", tuple(self.bodies))
        self._check_places()
        values = {key: float(value) for key, value in self.values.items()}
        object.__setattr__(self, "values", MappingProxyType(values))
        self._check_values()

    def __reduce__(self) -> tuple[object, ...]:
        # A mapping proxy cannot be pickled or deep-copied.
        return _rebuild, (self.effect, self.joints, self.bodies, dict(self.values))

    @property
    def places(self) -> tuple[str, ...]:
        """The joints or bodies that have it; empty for an effect of the world."""
        return self.joints or self.bodies

    def value(self, parameter: str, place: str | None = None) -> float:
        """The value of a parameter.

        Args:
            parameter: its name in `HIDEABLE`.
            place: the joint or body; needed where each has a value of its own.

        Returns:
            The value, in the parameter's unit.

        Raises:
            InputError: the effect has no such value.
        """
        for key in (f"{place}/{parameter}", parameter):
            if key in self.values:
                return self.values[key]
        raise InputError(
            f"{self.effect} has no value of {parameter!r} for {place!r}; it has "
            f"{', '.join(self.values)}"
        )

    def spread(
        self, parameter: str, names: Sequence[str], *, elsewhere: float = 0.0
    ) -> NDArray[np.float64]:
        """The parameter's value at each of a model's joints or bodies.

        Args:
            parameter: its name in `HIDEABLE`.
            names: names of all joints or bodies, n of them.
            elsewhere: the value where the effect is not.

        Returns:
            Values, shape (n,), in the parameter's unit.

        Raises:
            InputError: the effect names a joint or body that is not among `names`.
        """
        for place in self.places:
            if place != "*" and place not in names:
                raise InputError(
                    f"{self.effect} is hidden in {place!r}, which the model does not have"
                    f"{closest(place, names)}; it has {', '.join(names)}"
                )
        here = names if self.places == ("*",) else self.places
        return np.array(
            [self.value(parameter, name) if name in here else elsewhere for name in names]
        )

    def describe(self) -> str:
        """One line for people: the effect, its place, its values with units."""
        where = "all joints" if self.places == ("*",) else ", ".join(self.places)
        parts = []
        for parameter in HIDEABLE[self.effect].parameters:
            unit = f" {parameter.unit}" if parameter.unit else ""
            sign = "+" if parameter.least < 0 else ""
            if parameter.name in self.values:
                parts.append(f"{parameter.name} {self.values[parameter.name]:{sign}.3g}{unit}")
                continue
            each = (f"{self.value(parameter.name, p):{sign}.3g} ({p})" for p in self.places)
            parts.append(f"{parameter.name} [{', '.join(each)}]{unit}")
        return f"{self.effect}{' on ' + where if where else ''}: {', '.join(parts)}"

    def _check_places(self) -> None:
        on = HIDEABLE[self.effect].on
        for kind, names in (("joints", self.joints), ("bodies", self.bodies)):
            if kind != on and names:
                raise InputError(
                    f"{self.effect} is an effect of the {on}, not of the {kind}; leave {kind}="
                    f"{names} out"
                )
            if kind == on and not names:
                example = ', or ("*",) for all' if on == "joints" else ""
                raise InputError(f"{self.effect} names no {kind}; give {kind}=(name, ...){example}")
        if len(set(self.places)) < len(self.places) or (
            "*" in self.places and (self.places != ("*",) or on == "bodies")
        ):
            raise InputError(
                f"{self.effect} has {on} {self.places}; give each name once, and '*' for all "
                "joints only by itself"
            )

    def _check_values(self) -> None:
        expected: set[str] = set()
        for parameter in HIDEABLE[self.effect].parameters:
            own = {f"{place}/{parameter.name}" for place in self.places if place != "*"}
            keys = own if own and own <= set(self.values) else {parameter.name}
            expected |= keys
            for key in sorted(keys & set(self.values)):
                value = self.values[key]
                below = value < parameter.least or (
                    parameter.exclusive and value <= parameter.least
                )
                if below or not math.isfinite(value):
                    bound = f" and {'>' if parameter.exclusive else '>='} {parameter.least:g}"
                    raise InputError(
                        f"{self.effect} has {key} = {value}; it must be finite"
                        f"{bound if math.isfinite(parameter.least) else ''} {parameter.unit}"
                    )
        if set(self.values) != expected:
            raise InputError(
                f"{self.effect} has values {sorted(self.values)} where it takes "
                f"{sorted(expected)}, each once for all or as '<name>/<parameter>' for each of "
                f"{self.places or 'no places'}"
            )


def _rebuild(
    effect: str, joints: tuple[str, ...], bodies: tuple[str, ...], values: Mapping[str, float]
) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=joints, bodies=bodies, values=values)
