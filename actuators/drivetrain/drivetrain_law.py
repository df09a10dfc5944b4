"""A drivetrain law: a pure change of target, effort or friction before each physics step.

    law = StribeckFriction(joint_names_expr=(".*_knee",), breakaway=0.3, velocity=0.05)

Laws run in three stages, each over arrays `(..., n_joints)`: those of the controller change the
target, those of the drive its effort, those of the joint its friction. What a law adds shows in the
effort that a drive reports only where it says so.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.config_fields import names
from walkerkit.actuators.selection import Numbers, per_joint

FloatArray = NDArray[np.float64]
SOON = 0.05
"""Of a step: when its beginning is looked at, by which time what has no memory has followed."""
Stage = Literal["controller", "drive", "joint"]
_DEFINED: dict[str, type[DrivetrainLaw]] = {}


@dataclass(kw_only=True, eq=False)
class Step:
    """One physics step at n joints, as the laws find and leave it; arrays (..., n_joints).

    Attributes:
        dt: length of the step [s].
        time: since the start, () or (n_sims, 1) [s].
        q: positions [rad; m].
        qd: velocities [rad/s; m/s].
        stiffness: kp of the drive, 0 where it follows no position [N·m/rad; N/m].
        damping: kd of the drive [N·m·s/rad; N·s/m].
        limit: the drive's effort limit [N·m; N], infinite where it has none.
        target: position target [rad; m]; laws of the controller replace it.
        effort: effort of the drive, as it would report it [N·m; N]; laws of the drive replace it.
        extra: effort at the joint besides, which no drive reports [N·m; N].
        friction: dry friction besides what the model has [N·m; N].
        dry: dry friction that the model has [N·m; N].
        held: what MuJoCo's constraints, dry friction among them, did to the joint in the last step
            [N·m; N]; zero where no law reads it.
        play, play_speed: position [rad; m] and velocity [rad/s; m/s] of what gives way between
            joint and link; zero where nothing does, or no law reads it.
        target_ahead, effort_ahead: of the target and of the reported effort, what they are at the
            step's beginning over their mean over it, where they jump within it.
        voltage: of the supply, (n_sims, 1) or less [V]; NaN where nobody knows it.
        supply: what the drives have of the voltage that they are made for [1]; laws of the drive
            replace it.
    """

    dt: float
    time: FloatArray
    q: FloatArray
    qd: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    limit: FloatArray
    target: FloatArray
    effort: FloatArray
    extra: FloatArray
    friction: FloatArray
    dry: FloatArray
    held: FloatArray
    play: FloatArray = field(default_factory=lambda: np.zeros(1))
    play_speed: FloatArray = field(default_factory=lambda: np.zeros(1))
    target_ahead: FloatArray = field(default_factory=lambda: np.zeros(1))
    effort_ahead: FloatArray = field(default_factory=lambda: np.zeros(1))
    voltage: FloatArray = field(default_factory=lambda: np.full(1, np.nan))
    supply: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.supply = np.ones_like(self.q)


Parameters = Mapping[str, FloatArray]
State = dict[str, FloatArray]


@dataclass(frozen=True, kw_only=True)
class DrivetrainLaw(abc.ABC):
    """A law of some joints; its other fields are its parameters, one number per joint each.

    Attributes:
        joint_names_expr: full-match regular expressions of the joints that have it.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    state: ClassVar[tuple[str, ...]] = ()
    """Names of what it remembers from step to step; NaN where nothing has happened yet."""
    neutral: ClassVar[Mapping[str, float]]
    """Parameters at which it does nothing; those after the first `sizes` are idle there."""
    sizes: ClassVar[int] = 1
    reads_held: ClassVar[bool] = False
    """It reads `Step.held`."""
    reads_play: ClassVar[bool] = False
    """It reads `Step.play`."""
    targets_only: ClassVar[bool] = False
    """It reads and changes nothing but targets, by the time: what it makes of a whole series of
    them can be known beforehand."""
    constant: ClassVar[bool] = False
    """It reads nothing of the step and remembers nothing, and is of the joint: it adds the same
    effort and friction to every step."""

    joint_names_expr: tuple[str, ...] = names()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        name = cls.__dict__.get("name")
        if name is None:
            if hasattr(cls, "name"):
                raise ValueError(
                    f"{cls.__qualname__} has the name {cls.name!r} of {cls.__mro__[1].__qualname__}"
                    ": give it a `name` of its own, by which files know it"
                )
            return  # a base of several laws
        if _ours(_DEFINED.get(name)) and not _ours(cls):
            raise ValueError(
                f"name is {name!r} of the law {cls.__qualname__}, but walkerkit has a law of that "
                "name: give yours another one"
            )
        _DEFINED[name] = cls  # a class that is defined again, as in a notebook, replaces the old

    def __post_init__(self) -> None:
        if set(self.neutral) != set(self.parameter_names()):
            raise TypeError(
                f"{type(self).__qualname__} has the parameters {list(self.parameter_names())} and "
                f"neutral values for {list(self.neutral)}: `neutral` needs one for each parameter"
            )
        for item in fields(self):
            if "check" in item.metadata:
                value = item.metadata["check"](item.name, getattr(self, item.name))
                object.__setattr__(self, item.name, value)

    @staticmethod
    @abc.abstractmethod
    def apply(step: Step, p: Parameters, state: State) -> None:
        """Changes the step.

        Args:
            step: written to.
            p: parameters as `prepared`, (n_joints,) or (n_sims, n_joints) each.
            state: what it remembers, (..., n_joints) each, or (..., n_joints, depth) where it has
                a `depth`; written to.
        """

    @classmethod
    def prepared(cls, p: Parameters, dt: float) -> Parameters:
        """Its parameters, and what `apply` would make of them alone in every step.

        Args:
            p: parameters, (n_joints,) or (n_sims, n_joints) each.
            dt: the step [s].
        """
        return p

    @classmethod
    def depth(cls, p: Parameters, dt: float) -> int | None:
        """How many numbers of each kind it remembers of a joint; None for a single one.

        Args:
            p: parameters, (n_joints,) or (n_sims, n_joints) each.
            dt: the step [s].
        """
        return None

    @classmethod
    def acting(cls, p: Parameters) -> NDArray[np.bool_]:
        """Where these parameters, of one shape each, let it do anything."""
        sizes = cls.parameter_names()[: cls.sizes]
        found: NDArray[np.bool_] = np.any([p[name] != cls.neutral[name] for name in sizes], axis=0)
        return found

    @classmethod
    def parameter_names(cls) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(item.name for item in fields(cls) if item.name != "joint_names_expr")

    def numbers(self, joints: tuple[str, ...]) -> dict[str, FloatArray]:
        """Its parameters, one number for each of these joints."""
        values: dict[str, Numbers] = {name: getattr(self, name) for name in self.parameter_names()}
        return {name: per_joint(value, joints, field=name) for name, value in values.items()}


def defined_laws() -> dict[str, type[DrivetrainLaw]]:
    """Every law that was defined in this process, by name: walkerkit's and those of users."""
    return dict(_DEFINED)


def _ours(law: type[DrivetrainLaw] | None) -> bool:
    return law is not None and law.__module__.startswith("walkerkit.")


def first(remembered: FloatArray, now: FloatArray) -> FloatArray:
    """What is remembered, or the present value where nothing is yet."""
    return np.where(np.isnan(remembered), now, remembered)


def clipped(values: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray:
    """Values within bounds; `numpy.clip` takes several times as long for a few joints."""
    return np.minimum(np.maximum(values, low), high)


class Lag(DrivetrainLaw):
    """A law with a first-order filter of `time_constant` [s], which passes its input without one.

    The input is held for a step; what a filter makes of it is its mean over the step, which joins
    the unfiltered input smoothly as the time constant goes to 0.
    """

    @classmethod
    def prepared(cls, p: Parameters, dt: float) -> Parameters:
        """As in `DrivetrainLaw`; what is left of a difference, and passes of a jump."""
        ratio = p["time_constant"] / dt
        steps = 1.0 / np.maximum(ratio, 1e-9)  # of which each leaves e⁻¹; many without a filter
        left = np.exp(-steps)
        passing = -np.expm1(-SOON * steps)
        return {**p, "left": left, "mean": ratio * (1.0 - left), "passing": passing}

    @staticmethod
    def lagged(
        remembered: FloatArray, now: FloatArray, ahead: FloatArray | float, p: Parameters
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the filter makes of an input.

        Args:
            remembered: where it stands, NaN where it has not begun.
            now: the input, in any unit.
            ahead: what the input is at the step's beginning over that.
            p: parameters as `prepared`.

        Returns:
            Its mean over the step, how far it jumps within it as `ahead` says of the input, and
            where it stands at the end.
        """
        behind = first(remembered, now) - now
        return now + behind * p["mean"], ahead * p["passing"], now + behind * p["left"]
