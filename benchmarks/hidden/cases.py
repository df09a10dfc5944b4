"""The cases of each tier: what is hidden where, frozen by number.

    case = cases("one_effect")[17]
    case.name                       # "one_effect-017"

A case does not depend on how many are run, on the catalogue or on the machine. Each draw is as many
cases again, of other pairs, places and sizes; from the second on, draw 1, also of other robots:

    cases("one_effect", draw=1)[17].name                        # "one_effect-017/1"
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from walkerkit.gap.rehearsal.hardware import BaseLog
from walkerkit.gap.rehearsal.hideable import HIDEABLE, NAMELESS

Channels = Literal["q", "q+qd", "q+qd+tau"]
Off = Literal["", "substeps", "timestep", "integrator", "nuisance", "clutter"]
_Tier = Callable[[str, np.random.Generator], list["Case"]]

SIGNALS: Final[Mapping[Channels, tuple[str, ...]]] = {
    "q": ("position_target", "position"),
    "q+qd": ("position_target", "position", "velocity"),
    "q+qd+tau": ("position_target", "position", "velocity", "effort"),
}
"""What a log has under each choice of channels."""
NUISANCES: Final = ("armature", "viscous_friction", "coulomb_friction")
"""Names that are no false alarm where these numbers are a little off."""
ORDINARY: Final = (*NUISANCES, "position_gain", "velocity_gain", "command_delay")
"""Effects of which every model of a real robot has some."""
CLUTTER: Final = (*ORDINARY, "presliding_friction")
"""What a cluttered robot has beside the hidden effect; see `benchmarks.hidden.clutter`."""
GROUND: Final = ("ground_compliance",)
"""What a robot that walks has beside it: feet land on springs, which no contact of the model is."""

_LATER = (
    "supply_voltage",
    "mount_compliance",
)  # than the cases: these stay as they are, and have them at their end
_FIRST = tuple(name for name in HIDEABLE if name not in _LATER)
_EVERY = (*_FIRST, "timestep")
_RARE = tuple(name for name in HIDEABLE if name not in CLUTTER)
_OFF: tuple[Off, ...] = ("", "substeps", "timestep", "integrator", "nuisance", "nuisance")
# What one joint of twelve can have.
_OF_A_JOINT = tuple(n for n in _FIRST if HIDEABLE[n].on == "joints" and not HIDEABLE[n].shared)
_UNDER_FEET = ("ground_friction", "ground_compliance", "payload", "com_offset")
_IN_LEGS = (
    *("coulomb_friction", "viscous_friction", "armature", "position_gain"),
    *("torque_constant", "encoder_offset", "actuator_lag", "command_delay"),
)
# With all channels, what another name says exactly is not taken out of the catalogue.
_TOLD_ALIKE = ("encoder_offset", "base_tilt", "com_offset", "torque_bias", "coulomb_friction")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One robot with its logs, to be diagnosed.

    Attributes:
        tier: the tier's name.
        number: of the case in its tier.
        rig: name of the robot in `walkerkit.benchmarks.hidden.rigs.RIGS`.
        channels: what its logs have.
        hide: names of the hidden effects.
        single: a joint effect sits in one joint; drawn by default.
        body: the body that has a body's effect; drawn by default.
        removed: the workflow does not know the hidden effects, nor what leaves the same logs.
        off: what else is not as in the model.
        base: what its logs have of a base that floats.
        shorter: by which the time of its experiments is divided.
        draw: which draw it is of; from 1 on, the robot has other numbers and its log another rate.
    """

    tier: str
    number: int
    rig: str
    channels: Channels
    hide: tuple[str, ...] = ()
    single: bool = False
    body: str | None = None
    removed: bool = False
    off: Off = ""
    base: BaseLog = "pose"
    shorter: float = 1.0
    draw: int = 0

    @property
    def name(self) -> str:
        """What it is called in results."""
        return f"{self.tier}-{self.number:03d}{f'/{self.draw}' if self.draw else ''}"

    @property
    def seed(self) -> int:
        """Of everything that is drawn for it."""
        return zlib.crc32(self.name.encode())

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of what is otherwise than in the model beside what is hidden."""
        off = {"nuisance": NUISANCES, "clutter": CLUTTER}.get(self.off, ())
        return (*off, *GROUND) if self.rig == "trotting_quadruped" else off

    @property
    def robot(self) -> int | None:
        """Seed of its robot's numbers; None for those of the rig as it is."""
        return self.seed if self.draw else None


def _one_effect(channels: Channels) -> _Tier:
    def cases_of(tier: str, rng: np.random.Generator) -> list[Case]:
        """Every effect on one rig of the two, then every effect on the other."""
        rigs = {effect: int(rng.integers(2)) for effect in _EVERY}
        chosen = [
            (str(effect), ("pendulum", "leg")[(rigs[str(effect)] + turn) % 2])
            for turn in range(2)
            for effect in rng.permutation(_EVERY)
        ]
        chosen += [(effect, rig) for effect in _LATER for rig in ("pendulum", "leg")]
        return [
            Case(tier=tier, number=i, rig=rig, channels=channels, hide=(effect,))
            for i, (effect, rig) in enumerate(chosen)
        ]

    return cases_of


def _two_effects(tier: str, rng: np.random.Generator) -> list[Case]:
    """Pairs of effects, each effect in three or two."""
    pairs: list[tuple[str, str]] = []
    for _ in range(3):
        order = [str(effect) for effect in rng.permutation(_FIRST)]
        pairs += zip(order[::2], order[1::2], strict=False)
    pairs += [(effect, "coulomb_friction") for effect in _LATER]
    return [
        Case(tier=tier, number=i, rig=("leg", "pendulum")[i % 2], channels="q+qd+tau", hide=pair)
        for i, pair in enumerate(pairs)
    ]


def _nothing(tier: str, rng: np.random.Generator) -> list[Case]:
    """Nothing hidden, and numbers off that are no effect, under all channels."""
    kinds = list(itertools.product(("pendulum", "leg"), SIGNALS, _OFF))
    order = [kinds[int(k)] for _ in range(3) for k in rng.permutation(len(kinds))]
    return [
        Case(tier=tier, number=i, rig=rig, channels=channels, off=off)
        for i, (rig, channels, off) in enumerate(order)
    ]


def _outside(tier: str, rng: np.random.Generator) -> list[Case]:
    """What the workflow has no name for: an effect that it is not told of, or a trouble."""
    taken = [str(e) for e in rng.permutation([e for e in _FIRST if e not in _TOLD_ALIKE])]
    troubles = [(trouble, rig) for trouble in NAMELESS for rig in ("leg", "pendulum")]
    chosen: list[tuple[str, str]] = []
    for i, effect in enumerate(taken):
        chosen.append((effect, ("leg", "pendulum")[int(rng.integers(2))]))
        if i % 2:
            chosen.append(troubles[i // 2 % len(troubles)])
    return [
        Case(
            tier=tier,
            number=i,
            rig=rig,
            channels="q+qd+tau",
            hide=(name,),
            removed=name in HIDEABLE,
        )
        for i, (name, rig) in enumerate(chosen)
    ]


def _one_of_twelve(tier: str, rng: np.random.Generator) -> list[Case]:
    """An effect in one joint of a quadruped."""
    order = rng.permutation(_OF_A_JOINT)
    return [
        Case(
            tier=tier,
            number=i,
            rig="hung_quadruped",
            channels="q+qd+tau",
            hide=(str(name),),
            single=True,
        )
        for i, name in enumerate(order)
    ]


def _on_feet(rig: str, base: BaseLog) -> _Tier:
    def cases_of(tier: str, rng: np.random.Generator) -> list[Case]:
        """An effect of the ground, of the trunk or of the legs, of a quadruped on its feet."""
        effects = [
            effect
            for _ in range(2)
            for pair in itertools.zip_longest(
                rng.permutation(_UNDER_FEET), *rng.permutation(_IN_LEGS).reshape(2, -1)
            )
            for effect in map(str, pair)
        ]
        return [
            Case(
                tier=tier,
                number=i,
                rig=rig,
                channels="q+qd+tau",
                hide=(effect,),
                single=effect in _IN_LEGS and not HIDEABLE[effect].shared,
                body="trunk" if effect in _UNDER_FEET else None,
                base=base,
            )
            for i, effect in enumerate(effects)
        ]

    return cases_of


def _standing(tier: str, rng: np.random.Generator) -> list[Case]:
    """What is under the feet, and then also what is in the legs, of a quadruped that stands."""
    first = [
        Case(
            tier=tier,
            number=i,
            rig="standing_quadruped",
            channels="q+qd+tau",
            hide=(_UNDER_FEET[i % len(_UNDER_FEET)],),
            body="trunk",
        )
        for i in range(24)
    ]
    others = _on_feet("standing_quadruped", "pose")(tier, rng)
    legs = [case for case in others if case.hide[0] in _IN_LEGS]
    return [*first, *(replace(one, number=24 + i) for i, one in enumerate(legs))]


def _nothing_on_feet(tier: str, rng: np.random.Generator) -> list[Case]:
    """Nothing hidden, of a quadruped on its feet."""
    kinds = list(
        itertools.product(("standing_quadruped", "trotting_quadruped"), ("pose", "imu"), _OFF)
    )
    return [
        Case(tier=tier, number=i, rig=rig, channels="q+qd+tau", off=off, base=base)
        for i, (rig, base, off) in enumerate(kinds[int(k)] for k in rng.permutation(len(kinds)))
    ]


def _cluttered(tier: str, rng: np.random.Generator) -> list[Case]:
    """Every effect that is not ordinary, on a robot of 1, 3 or 12 joints that is off everywhere."""
    rigs = ("pendulum", "leg", "hung_quadruped")
    return [
        Case(
            tier=tier,
            number=i,
            rig=rigs[i % len(rigs)],
            channels="q+qd+tau",
            hide=(str(name),),
            single=rigs[i % len(rigs)] == "hung_quadruped" and str(name) in _OF_A_JOINT,
            off="clutter",
            shorter=2.0,
        )
        for i, name in enumerate(rng.permutation(_RARE))
    ]


TIERS: Final[Mapping[str, _Tier]] = {
    "one_effect": _one_effect("q+qd+tau"),
    "one_effect_q_qd": _one_effect("q+qd"),
    "one_effect_q": _one_effect("q"),
    "two_effects": _two_effects,
    "nothing": _nothing,
    "outside": _outside,
    "one_of_twelve": _one_of_twelve,
    "standing": _standing,
    "standing_imu": _on_feet("standing_quadruped", "imu"),
    "trotting": _on_feet("trotting_quadruped", "pose"),
    "trotting_imu": _on_feet("trotting_quadruped", "imu"),
    "nothing_on_feet": _nothing_on_feet,
    "cluttered": _cluttered,
}
"""The tiers by name, each with what makes its cases."""


def cases(tier: str, count: int | None = None, *, draw: int = 0) -> list[Case]:
    """The cases of a tier.

    Args:
        tier: name of the tier.
        count: how many of them, the first ones, which are a fair sample; all by default.
        draw: which draw of them.
    """
    label = f"{tier}/{draw}" if draw else tier
    every = TIERS[tier](tier, np.random.default_rng(zlib.crc32(label.encode())))
    return [replace(case, draw=draw) for case in every[:count]]
