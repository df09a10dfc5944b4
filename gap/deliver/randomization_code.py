"""Ranges to randomize over, from what the recordings leave open.

    text = randomization_code(findings)     # randomization.py, which needs numpy alone

Numbers are drawn together, with the correlation that the fit has found: where the recordings say
that damping and dry friction exchange, every draw of the two explains them. What runs into a bound,
and what the recordings do not determine, stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.deliver.findings import DIAGNOSIS, Findings
from walkerkit.gap.deliver.trainers import Trainer
from walkerkit.gap.errors import InputError

FloatArray = NDArray[np.float64]

_NORMAL_95 = 1.96


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """What is known of the numbers that vary.

    Attributes:
        keys: effect, place and name of each.
        fields: where each is in the model's files.
        units: of each.
        mean: (n,) the numbers of the mended model.
        std: (n,) standard errors.
        correlation: (n, n).
        lower, upper: (n,) within which all draws stay.
        fixed: keys of what is not drawn, with the reason.
        alternatives: effect to the effects that explain the recordings as well.
    """

    keys: tuple[tuple[str, str, str], ...]
    fields: tuple[str, ...]
    units: tuple[str, ...]
    mean: FloatArray
    std: FloatArray
    correlation: FloatArray
    lower: FloatArray
    upper: FloatArray
    fixed: Mapping[tuple[str, str, str], str]
    alternatives: Mapping[str, tuple[str, ...]]

    def draw(self, random: np.random.Generator, n: int) -> FloatArray:
        """(n, n_numbers) joint draws, none beyond the bounds.

        Args:
            random: where the randomness comes from.
            n: how many.
        """
        covariance = self.correlation * np.outer(self.std, self.std)
        drawn = random.multivariate_normal(self.mean, covariance, size=n, method="eigh")
        return np.clip(drawn, self.lower, self.upper)


def posterior(found: Findings) -> Posterior:
    """What a diagnosis knows of its numbers.

    Raises:
        InputError: its correlations are none.
    """
    everything = [(effect, p) for effect in found.effects for p in effect["parameters"]]
    correlation = np.array(found.content.get("correlation") or np.eye(len(everything)), dtype=float)
    if not np.allclose(correlation, correlation.T) or not np.allclose(correlation.diagonal(), 1.0):
        raise InputError(
            f"{found.folder / DIAGNOSIS}: its correlation is not symmetric with ones on the "
            "diagonal, as earlier versions wrote it of several effects. Diagnose once more."
        )
    fixed, drawn = {}, []
    for number, (effect, p) in enumerate(everything):
        reason = _fixed(p)
        if reason:
            fixed[_key(effect, p)] = reason
        else:
            drawn.append(number)
    chosen = [everything[number] for number in drawn]
    moved = [_moved(p) for _, p in chosen]
    return Posterior(
        keys=tuple(_key(effect, p) for effect, p in chosen),
        fields=tuple(p["field"] for _, p in chosen),
        units=tuple(p["unit"] for _, p in chosen),
        mean=np.array([p["value"] + by for (_, p), by in zip(chosen, moved, strict=True)]),
        std=np.array([p["std"] for _, p in chosen], dtype=float),
        correlation=correlation[np.ix_(drawn, drawn)],
        lower=np.array([_bound(p, "lower", by) for (_, p), by in zip(chosen, moved, strict=True)]),
        upper=np.array([_bound(p, "upper", by) for (_, p), by in zip(chosen, moved, strict=True)]),
        fixed=fixed,
        alternatives={
            effect["effect"]: tuple(effect["indistinguishable_from"])
            for effect in found.effects
            if effect["indistinguishable_from"]
        },
    )


def _fixed(p: Mapping[str, Any]) -> str:
    if p["at_bound"]:
        return "its estimate ran into a bound"
    if p["std"] is None:
        return "the recordings do not determine it"
    return "it was chosen among a few" if p["std"] == 0 else ""


def _key(effect: Mapping[str, Any], p: Mapping[str, Any]) -> tuple[str, str, str]:
    return effect["effect"], p.get("joint", p.get("body", "*")), p["name"]


def _moved(p: Mapping[str, Any]) -> float:
    """What the model's own number adds to the estimate."""
    return 0.0 if p["is"] is None else float(p["is"]) - float(p["value"])


def _bound(p: Mapping[str, Any], side: str, moved: float) -> float:
    bound = p.get(side)
    if bound is None:
        return -np.inf if side == "lower" else np.inf
    return float(bound) + moved


_USES = {
    "mjlab": """An attribute is randomized by its array of the simulation's model
(joint/frictionloss: dof_frictionloss). A delay over the timestep, rounded, is a lag: widen
delay_min_lag and delay_max_lag in robot.py, set delay_hold_prob=1.0 beside them, and call set_lags
of the robot's actuators after each reset.""",
    "isaaclab": """An attribute is written to the articulation (joint/damping:
write_joint_damping_to_sim and so on). A delay over the timestep, rounded, goes between min_delay
and max_delay of actuators.py, of which each reset draws one.""",
    "mjx": """An attribute goes into its array of the mjx.Model (joint/frictionloss:
model.dof_frictionloss; actuator/kp: actuator_gainprm[:, 0] and minus actuator_biasprm[:, 1]). What
drivetrain.py has goes there, such as delays d of the joints:

    mjx_step(..., parameters={**PARAMETERS, "command_delay": {"delay": d}})""",
    "warp": """An attribute goes into its array of the mujoco_warp Model (joint/frictionloss:
dof_frictionloss), with a row for each world.""",
}


def randomization_code(known: Posterior, trainer: Trainer) -> str:
    """`randomization.py`: the ranges, and a function that draws.

    Args:
        known: what is known of the numbers.
        trainer: whose they are to be.
    """
    low, high = (known.mean + sign * _NORMAL_95 * known.std for sign in (-1, 1))
    low, high = np.maximum(low, known.lower), np.minimum(high, known.upper)
    lines = [
        '"""What to randomize: numbers as the recordings leave them open, made by walkerkit.',
        "",
        "RANGES has the 95 % interval of each number alone, in the unit of its field. Numbers that",
        "depend on each other are drawn together by draw(), not one by one from their ranges.",
        "",
        _USES[trainer],
        '"""',
        "",
        "import numpy as np",
        "",
        "# (effect, joint or body, number): (field, unit, from, to)",
        "RANGES = {",
        *(
            f"    {key!r}: ({field!r}, {unit!r}, {lo:.6g}, {hi:.6g}),"
            for key, field, unit, lo, hi in zip(
                known.keys, known.fields, known.units, low, high, strict=True
            )
        ),
        "}",
        f"FIXED = {dict(known.fixed)!r}",
        f"ALTERNATIVES = {dict(known.alternatives)!r}",
        f"MEAN = np.array({_list(known.mean)})",
        f"STD = np.array({_list(known.std)})",
        f"CORRELATION = np.array([{', '.join(map(_list, known.correlation))}])",
        f"LOWER = np.array({_list(known.lower)})",
        f"UPPER = np.array({_list(known.upper)})",
        "",
        "",
        "def draw(random, n):",
        '    """n draws: key to (n,) values of its field. `random` is a numpy Generator."""',
        "    if not RANGES:",
        "        return {}",
        "    covariance = CORRELATION * np.outer(STD, STD)",
        '    drawn = random.multivariate_normal(MEAN, covariance, size=n, method="eigh")',
        "    drawn = np.clip(drawn, LOWER, UPPER)",
        "    return dict(zip(RANGES, drawn.T, strict=True))",
    ]
    return "\n".join(lines) + "\n"


def _list(values: FloatArray) -> str:
    names = {np.inf: "np.inf", -np.inf: "-np.inf"}
    return f"[{', '.join(names.get(v, repr(v)) for v in map(float, values))}]"
