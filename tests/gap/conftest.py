"""A diagnosis of a leg, as the workflow would return it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from walkerkit.gap.report.diagnosis import (
    Change,
    Considered,
    Diagnosis,
    Estimate,
    NamedEffect,
    NextExperiment,
    Trace,
)
from walkerkit.gap.report.gaps import Gap, GapMap, GapSize, Location

LegDiagnosis = Callable[..., Diagnosis]

# Regime to the part of a joint's gap and of its samples; what does not stand out is left out.
_REGIMES = {
    "velocity_reversal": (0.6, 0.18),
    "high_acceleration": (0.31, 0.14),
    "high_effort": (0.18, 0.12),
    "backward": (0.55, 0.46),
    "everywhere": (1.0, 1.0),
}
_CANDIDATES = (
    ("coulomb_friction", 0.83, "named"),
    ("backlash", 0.79, "lost"),
    ("stribeck_friction", 0.77, "lost"),
    ("viscous_friction", 0.31, "lost"),
    ("controller_deadband", 0.24, "lost"),
    ("armature", 0.08, "lost"),
    ("series_elasticity", 0.07, "lost"),
    ("torque_constant", 0.05, "lost"),
    ("command_delay", 0.03, "lost"),
    ("payload", 0.004, "lost"),
    ("cogging", -0.02, "lost"),
    ("loop_delay", float("-inf"), "lost"),
)


@pytest.fixture
def leg() -> LegDiagnosis:
    """Makes the diagnosis; `joints` renames hip, thigh and calf."""
    return leg_diagnosis


def leg_diagnosis(
    joints: Sequence[str] = ("hip", "thigh", "calf"), samples: int = 3000, seconds: float = 12.3
) -> Diagnosis:
    """Coulomb friction on the calf, in three recordings of which the last was held out."""
    hip, thigh, calf = joints
    return Diagnosis(
        verdict="explained",
        gap=Gap(
            position=GapSize(
                unit="rad", before=0.0066, after=0.0011, noise_floor=0.0010, numerical_floor=0.0003
            ),
            horizon=None,
            finer_position=None,
            joints={
                hip: GapSize(unit="rad", before=0.0012, after=0.00105, noise_floor=0.0010),
                thigh: GapSize(unit="rad", before=0.0021, after=0.00112, noise_floor=0.0010),
                calf: GapSize(unit="rad", before=0.0114, after=0.00114, noise_floor=0.0010),
            },
            signals={
                "position": GapSize(unit="rad", before=0.0066, after=0.0011, noise_floor=0.0010),
                "effort": GapSize(
                    unit="N·m", before=0.52, after=0.041, noise_floor=0.03, numerical_floor=0.012
                ),
            },
        ),
        locations=_locations(hip=(hip, 0.05), thigh=(thigh, 0.12), calf=(calf, 0.83)),
        remaining=_locations(hip=(hip, 0.33), thigh=(thigh, 0.33), calf=(calf, 0.34)),
        effects=(
            NamedEffect(
                effect="coulomb_friction",
                joints=(calf,),
                bodies=(),
                confidence=0.98,
                parameters=(
                    Estimate(
                        name="frictionloss",
                        place=calf,
                        value=0.1523,
                        std=0.0041,
                        unit="N·m",
                        at_bound=False,
                        lower=0.0,
                        upper=3.2,
                        field="joint/frictionloss",
                        changes=(Change(model="leg", place=calf, was=0.05, now=0.2023),),
                    ),
                ),
                gap_after=0.0011,
                indistinguishable_from=(),
            ),
        ),
        considered=tuple(
            Considered(round=1, effect=effect, improvement=gain, verdict=verdict)  # type: ignore[arg-type]
            for effect, gain, verdict in _CANDIDATES
        ),
        next_experiment=None,
        recordings=("chirp", "steps", "walk"),
        notes=("The velocity of hip was not recorded; the gap was taken from its position alone.",),
        traces=tuple(
            _trace(name, joint, error, samples)
            for name in ("chirp", "steps", "walk")
            for joint, error in ((hip, 0.001), (thigh, 0.002), (calf, 0.012))
        ),
        seconds=seconds,
        maps=(
            GapMap(
                signal="position",
                unit="rad",
                before=_cells(0.0066, hip=(hip, 0.05), thigh=(thigh, 0.12), calf=(calf, 0.83)),
                after=_cells(0.0011, hip=(hip, 0.33), thigh=(thigh, 0.33), calf=(calf, 0.34)),
            ),
            GapMap(
                signal="effort",
                unit="N·m",
                before=_cells(0.52, hip=(hip, 0.2), thigh=(thigh, 0.2), calf=(calf, 0.6)),
                after=_cells(0.041, hip=(hip, 0.3), thigh=(thigh, 0.3), calf=(calf, 0.4)),
            ),
        ),
    )


@pytest.fixture
def confused() -> Diagnosis:
    """Three effects in three rounds, some in doubt, at a bound or of a body; windows, no split."""
    leg = leg_diagnosis()
    friction = leg.effects[0]
    delay = NamedEffect(
        effect="command_delay",
        joints=("*",),
        bodies=(),
        confidence=0.52,
        parameters=(_estimate("delay", "*", 0.01234, 0.0002, "s"),),
        gap_after=0.0031,
        indistinguishable_from=("sensor_delay", "setpoint_filter"),
    )
    payload = NamedEffect(
        effect="payload",
        joints=(),
        bodies=("shin",),
        confidence=0.91,
        parameters=(_estimate("mass", "shin", 0.5, None, "kg"),),
        gap_after=0.0024,
        indistinguishable_from=(),
    )
    first = _at_step(friction, 0.0041)
    rounds = tuple(
        Considered(round=index, effect=effect, improvement=gain, verdict=verdict)  # type: ignore[arg-type]
        for index, effect, gain, verdict in (
            (1, "coulomb_friction", 0.4, "named"),
            (1, "backlash", 0.1, "lost"),
            (2, "command_delay", 0.24, "named"),
            (2, "sensor_delay", 0.24, "indistinguishable"),
            (2, "setpoint_filter", 0.239, "indistinguishable"),
            (3, "payload", 0.2, "named"),
        )
    )
    return Diagnosis(
        verdict="partly_explained",
        gap=Gap(
            position=GapSize(
                unit="rad", before=0.0066, after=0.0022, noise_floor=0.0010, numerical_floor=0.0003
            ),
            horizon=0.5,
            finer_position=None,
            joints=leg.gap.joints,
            signals={"effort": GapSize(unit="N·m", before=0.52, after=0.2, noise_floor=0.03)},
        ),
        locations=leg.locations,
        remaining=leg.remaining,
        effects=(first, delay, payload),
        considered=rounds,
        next_experiment=NextExperiment(
            excitation="disturbed_hold",
            between=("command_delay", "sensor_delay", "setpoint_filter"),
            separation=4.21,
            file="next_experiment.csv",
        ),
        recordings=leg.recordings,
        notes=("Payload ran into its bound.", "The recordings share one pose."),
        traces=leg.traces[:2],
        seconds=3.0,
    )


def _locations(**parts: tuple[str, float]) -> tuple[Location, ...]:
    found = [
        Location(joint=joint, regime=regime, share=share * part, lift=share * part / (samples / 3))
        for joint, share in parts.values()
        for regime, (part, samples) in _REGIMES.items()
    ]
    whole = [at for at in found if at.regime == "everywhere"]
    standing_out = [at for at in found if at.regime != "everywhere" and at.lift > 1.15]
    standing_out.sort(key=lambda at: -at.share * (at.lift - 1))
    return (*standing_out, *sorted(whole, key=lambda at: -at.share))


def _cells(rms: float, **parts: tuple[str, float]) -> tuple[Location, ...]:
    return tuple(replace(at, rms=rms * at.lift**0.5) for at in _locations(**parts))


def _trace(recording: str, joint: str, error: float, samples: int) -> Trace:
    time = np.arange(samples) / 250.0
    random = np.random.default_rng(sum(map(ord, recording)))
    phase = {"chirp": 2 + 6 * time / time[-1], "steps": 3.0, "walk": 9.0}[recording] * time
    ideal = 0.4 * np.sin(phase) if recording != "steps" else 0.3 * np.tanh(9 * np.sin(phase))
    lag = error * 1.4 * np.tanh(8 * np.cos(phase))
    return Trace(
        recording=recording,
        joint=joint,
        signal="position",
        unit="rad",
        held_out=recording == "walk",
        time=time,
        measured=ideal - lag + 0.001 * random.standard_normal(samples),
        before=ideal,
        after=ideal - lag,
        target=ideal + 0.02 * np.sin(phase),
    )


def _estimate(name: str, place: str, value: float, std: float | None, unit: str) -> Estimate:
    return Estimate(name=name, place=place, value=value, std=std, unit=unit, at_bound=std is None)


def _at_step(named: NamedEffect, gap_after: float) -> NamedEffect:
    return NamedEffect(**{**vars(named), "gap_after": gap_after})
