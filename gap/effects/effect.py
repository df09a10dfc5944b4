"""What an effect is: a name, an equation, parameters at sites, and how they enter a robot.

An effect is one small class, in a file of its family or in a user's own module. Writing it
registers it, wherever it is written:

    class ViscousFriction(Effect):
        name = "viscous_friction"
        equation = "τ = −b q̇"
        ...
        fields = {"damping": fields.joint("damping", "dof_damping")}
        def sites(self, robot): ...
        def parameters(self, robot, site): ...
        def apply(self, trials, site, values): ...

At every parameter's `zero` the robot is unchanged. Values are increments on what the model already
has, except limits, rest angles, timesteps and the numbers of laws, which are what they say.
"""

from __future__ import annotations

import abc
import inspect
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects.fields import Field
from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
SiteKind = Literal["joint", "body", "robot"]
Part = Literal[
    "friction", "mass", "pose", "gain", "strength", "timing", "encoder", "play", "ground", ""
]
ENTRY_POINTS = "walkerkit.effects"
"""Group of the entry points by which a package names the modules, or classes, of its effects."""
EVERYWHERE = "*"  # the site of an effect of the whole robot, and of a value shared by all joints


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of an effect at one site.

    Attributes:
        name: the field's name for it, e.g. `damping`.
        unit: SI unit, `rad` and `N·m` for a hinge.
        zero: the value at which the robot is unchanged.
        lower, upper: bounds of the fit; a value at one of them is not an estimate.
        end: one of these that is the simulation's own, past which it shows no change, so that a
            value there is an estimate; else None.
        scale: a typical size; the fit works in units of it.
        starts: magnitudes at which the effect is tried before fitting. Several, since a small step
            says nothing about limits and dead zones.
        choice: its values are those at the starts and none between, so that it is not fitted.
        inverse: name and unit of one over it, where that is what people speak of; else empty.
        prior: width of its prior, a Student t about `zero`: the size that is plausible before any
            log is seen. By default that of the largest start.
        shape: how the effect looks where its other numbers make some of it, such as the phase of a
            wave: by itself it changes nothing, so that to know it is not to know the effect.
    """

    name: str
    unit: str
    zero: float = 0.0
    lower: float
    upper: float
    scale: float
    starts: tuple[float, ...]
    choice: bool = False
    inverse: tuple[str, str] | tuple[()] = ()
    prior: float = 0.0
    shape: bool = False
    end: float | None = None

    @property
    def is_delay(self) -> bool:
        """Whether what it changes is no straight line but goes in steps of the simulation."""
        return self.name == "delay"

    def __post_init__(self) -> None:
        inside = all(self.lower <= value <= self.upper for value in (self.zero, *self.starts))
        ends = (None, self.lower, self.upper)
        if not (
            inside
            and self.lower < self.upper
            and self.scale > 0
            and self.starts
            and self.end in ends
        ):
            raise ValueError(f"parameter {self.name!r} contradicts itself: {self}")
        if not self.prior:
            plausible = max(self.scale, *(abs(start - self.zero) for start in self.starts))
            object.__setattr__(self, "prior", plausible)


_defined: list[type[Effect]] = []
_users: dict[str, type[Effect] | Effect] = {}


class Effect(abc.ABC):
    """One entry of the catalogue.

    Attributes:
        name: its name in the catalogue, the command line and the JSON.
        equation: what it adds, with its parameters and their units.
        symptom: where its residual shows.
        added_as: what it becomes in the model.
        source: where the equation is from.
        part: what of the robot it changes; empty for one of its own kind. Gains may be off by
            orders of magnitude, and times are known no better than the simulation's steps.
        kind: whether its sites are joints, bodies or the whole robot.
        shared: the same cause usually acts on all joints (a bus, a filter), so that one value for
            all is preferred where the data allow it.
        fitted: its numbers are fitted; otherwise they are chosen among their starts.
        ordinary: every model has its number a little wrong: of effects that explain as much it is
            the first to be named.
        extends: effects of which this one is a generalisation. It explains at least as much, and
            is worth a thought only where it explains more.
        resembles: effects that change much the same of how a joint moves. Where this one is named,
            they are fitted in its place whatever they promise.
        fields: parameter's name to the number of the robot's files that `apply` changes by it.
    """

    name: ClassVar[str]
    equation: ClassVar[str]
    symptom: ClassVar[str]
    added_as: ClassVar[str]
    source: ClassVar[str]
    part: ClassVar[Part] = ""
    kind: ClassVar[SiteKind] = "joint"
    shared: ClassVar[bool] = False
    fitted: ClassVar[bool] = True
    ordinary: ClassVar[bool] = False
    extends: ClassVar[tuple[str, ...]] = ()
    resembles: ClassVar[tuple[str, ...]] = ()
    fields: ClassVar[Mapping[str, Field]] = MappingProxyType({})

    def __init_subclass__(cls, *, listed: bool = True) -> None:
        super().__init_subclass__()
        if not listed:
            return  # it is in no catalogue
        if cls.__module__.startswith("walkerkit."):
            _defined.append(cls)
        elif "name" in cls.__dict__:
            _refuse_taken(cls)
            _users[cls.name] = cls  # defined again, as in a notebook, it replaces the old one

    @abc.abstractmethod
    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """Where it could act.

        Args:
            robot: the robot.
            joints: the joints that the recordings measure.

        Returns:
            Names of joints or bodies, or `("*",)`; empty where it cannot act on this robot.
        """

    @abc.abstractmethod
    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """Its parameters at one site, with their bounds on this robot."""

    @abc.abstractmethod
    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Adds the effect at one site to every trial.

        Args:
            trials: n variants, written to.
            site: the site.
            values: (n, n_parameters), in the parameters' units.
        """


class JointEffect(Effect):
    """An effect that can act on any measured joint."""

    kind = "joint"

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """All measured joints on which `acts_on` holds."""
        return tuple(name for name in joints if self.acts_on(robot, name))

    @abc.abstractmethod
    def acts_on(self, robot: Robot, joint: str) -> bool:
        """Whether the effect is possible at this joint."""


def registered() -> dict[str, Effect]:
    """Every concrete effect of this package, by name, in the order of definition."""
    return {cls.name: cls() for cls in _defined if not cls.__abstractmethods__}


def users_effects() -> dict[str, Effect]:
    """Every concrete effect that somebody else has defined, by name, in the order of definition.

    Raises:
        InputError: one of them does not say what the reports say of it.
    """
    _load_entry_points()
    found = {}
    for name, given in _users.items():
        if isinstance(given, Effect):
            found[name] = given
        elif not given.__abstractmethods__:
            _refuse_incomplete(given)
            # Of a class that takes arguments there is an effect as soon as one is given.
            if given.__init__ is object.__init__:
                found[name] = given()
    return found


def add_users_effect(effect: Effect) -> None:
    """Puts an effect that a user made himself into the catalogue.

    Raises:
        InputError: it does not say what the reports say of it.
    """
    _refuse_incomplete(type(effect))
    if not type(effect).__module__.startswith("walkerkit."):
        _users[effect.name] = effect


def identity(effect: Effect) -> str:
    """What tells an effect from others: its name, and of one of a user's its text besides."""
    if type(effect).__module__.startswith("walkerkit."):
        return effect.name
    try:
        text = inspect.getsource(type(effect))
    except (OSError, TypeError):  # it was typed in
        text = ""
    return f"{effect.name}\n{text}"


def _refuse_taken(cls: type[Effect]) -> None:
    if any(known.__dict__.get("name") == cls.name for known in _defined):
        raise ValueError(
            f"name is {cls.name!r} of the effect {cls.__qualname__}, but walkerkit has an effect "
            "of that name: give yours another one"
        )


def _refuse_incomplete(cls: type[Effect]) -> None:
    missing = [name for name in _TOLD if not isinstance(getattr(cls, name, None), str)]
    if missing:
        raise InputError(
            f"the effect {cls.__module__}.{cls.__qualname__} lacks {', '.join(missing)}. Give it "
            f'{"them" if len(missing) > 1 else "it"} as text, as in `{missing[0]} = "..."`.'
        )


@cache
def _load_entry_points() -> None:
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            entry.load()
        except Exception as error:  # it is somebody else's module
            warnings.warn(
                f"the effects of {entry.value!r} are not tried: it cannot be imported "
                f"({type(error).__name__}: {one_line(error)})",
                UserWarning,
                stacklevel=2,
            )


_TOLD = ("name", "equation", "symptom", "added_as", "source")
