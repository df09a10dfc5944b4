"""What a diagnosis said, as plain data beside what is true."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from benchmarks.hidden.outcome import Named, Value
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.report.diagnosis import Estimate, NamedEffect
from walkerkit.gap.simulation.robot import Robot

Truth = Callable[[Estimate], float | None]
"""An estimate of an effect to the number that it should be, or None where that is not known."""


def said(
    one: NamedEffect,
    effects: Sequence[NamedEffect],
    robot: Robot,
    signals: Collection[str],
    truth: Truth,
) -> Named:
    """An effect that was named.

    Args:
        one: the effect.
        effects: all that were named.
        robot: of which.
        signals: that its logs have.
        truth: of its numbers.
    """
    beside = [
        other.effect
        for other in effects
        if other is not one and (EVERYWHERE in other.joints or {*one.joints} <= {*other.joints})
    ]
    values = [
        Value(name=of.name, place=of.place, true=true, value=of.value, std=of.std)
        for of in one.parameters
        if not of.at_bound and (true := truth(of)) is not None
    ]
    return Named(
        effect=one.effect,
        places=places(one.joints, one.bodies, robot),
        confidence=one.confidence,
        doubt=one.indistinguishable_from,
        alike=alike(one.effect, one.joints, one.bodies, robot, signals, beside),
        values=tuple(values),
    )


def places(joints: Sequence[str], bodies: Sequence[str], robot: Robot) -> tuple[str, ...]:
    """The joints or bodies by name; of the whole robot all driven joints."""
    if EVERYWHERE in joints or not (joints or bodies):
        return tuple(sorted(name for name in robot.joints if robot.joints[name].drives))
    return tuple(sorted((*joints, *bodies)))


def alike(
    effect: str,
    joints: Sequence[str],
    bodies: Sequence[str],
    robot: Robot,
    signals: Collection[str],
    beside: Sequence[str] = (),
) -> tuple[str, ...]:
    """Effects that the catalogue documents as exactly equivalent where these signals are logged."""
    if effect not in CATALOGUE:
        return ()
    return tuple(
        equivalences(effect, signals, robot=robot, joints=joints, bodies=bodies, beside=beside)
    )
