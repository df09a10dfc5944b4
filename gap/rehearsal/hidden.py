"""What a rehearsal robot has and its model lacks, for the workflow to find.

    HiddenEffect(effect="coulomb_friction", joints=("calf",), values={"frictionloss": 0.6})
    HiddenEffect(
        effect="viscous_friction",
        joints=("hip", "calf"),
        values={"hip/damping": 0.3, "calf/damping": 0.1},
    )
    HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 0.008})
    HiddenEffect(effect="payload", bodies=("calf",), values={"mass": 0.2})

`HIDEABLE`, `GROUND` and `NAMELESS` list the effects with their parameters. A value is given once
for all of the effect's joints or bodies, or for each as `<joint>/<parameter>`. `joints=("*",)`
means every joint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.rehearsal.hideable import GROUND, HIDEABLE, NAMELESS, Hideable


@dataclass(frozen=True, kw_only=True)
class HiddenEffect:
    """An effect with its place and size.

    Attributes:
        effect: name from `HIDEABLE`, `GROUND` or `NAMELESS`.
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
        if self.effect not in {**HIDEABLE, **GROUND, **NAMELESS}:
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
    def kind(self) -> Hideable:
        """Where it can be and which numbers it has."""
        return {**HIDEABLE, **GROUND, **NAMELESS}[self.effect]

    @property
    def places(self) -> tuple[str, ...]:
        """The joints or bodies that have it; empty for an effect of the world."""
        return self.joints or self.bodies

    def value(self, parameter: str, place: str | None = None) -> float:
        """The value of a parameter.

        Args:
            parameter: its name in `kind`.
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
            parameter: its name in `kind`.
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

    def stronger(self, factor: float, places: Sequence[str] | None = None) -> HiddenEffect:
        """The same with more of it.

        Args:
            factor: by which the numbers that grow with the effect grow, and those that shrink with
                it shrink.
            places: the joints or bodies at which it becomes stronger, everywhere by default; what
                all have in common changes for all.
        """
        grows = {parameter.name: parameter.grows for parameter in self.kind.parameters}
        values = {}
        for key, value in self.values.items():
            place, _, name = key.rpartition("/")
            chosen = places is None or not place or place in places
            values[key] = value * factor ** (grows[name] if chosen else 0)
        return replace(self, values=values)

    def describe(self) -> str:
        """One line for people: the effect, its place, its values with units."""
        where = "all joints" if self.places == ("*",) else ", ".join(self.places)
        parts = []
        for parameter in self.kind.parameters:
            unit = f" {parameter.unit}" if parameter.unit else ""
            sign = "+" if parameter.least < 0 else ""
            if parameter.name in self.values:
                parts.append(f"{parameter.name} {self.values[parameter.name]:{sign}.3g}{unit}")
                continue
            each = (f"{self.value(parameter.name, p):{sign}.3g} ({p})" for p in self.places)
            parts.append(f"{parameter.name} [{', '.join(each)}]{unit}")
        return f"{self.effect}{' on ' + where if where else ''}: {', '.join(parts)}"

    def _check_places(self) -> None:
        on = self.kind.on
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
        for parameter in self.kind.parameters:
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


def total(
    hidden: Sequence[HiddenEffect], effect: str, parameter: str, names: Sequence[str]
) -> NDArray[np.float64]:
    """What all effects of one name add up to at each of a model's joints or bodies.

    Args:
        hidden: effects.
        effect: the name of those that are added up.
        parameter: which of their numbers.
        names: names of all joints or bodies, n of them.

    Returns:
        Sums, shape (n,), 0 where there is none, in the parameter's unit.
    """
    return sum(
        (one.spread(parameter, names) for one in hidden if one.effect == effect),
        np.zeros(len(names)),
    )
