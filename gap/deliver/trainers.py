"""What each trainer can simulate of each effect, and in which of its words.

    way("command_delay", "mjlab")       # Way(kind="config", says="delay_min_lag, delay_max_lag")

`docs/export.md` is this table; the exporters go by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from walkerkit.gap.effects import CATALOGUE

Trainer = Literal["mjlab", "isaaclab", "mjx", "warp"]
TRAINERS: tuple[Trainer, ...] = ("mjlab", "isaaclab", "mjx", "warp")
Kind = Literal["field", "config", "function", "cannot"]

MADE = "drivetrain.py"
_BESIDE = "actuators.json/laws/"
_OF_THE_LOG = {
    "sensor_delay": "observations come at once; delay them by hand",
    "kinematic_error": "observations lack the wave; add it by hand",
    "clock_skew": "it is of the log's clock, and nothing of the robot is lost",
}


@dataclass(frozen=True, kw_only=True)
class Way:
    """How a trainer has an effect.

    Attributes:
        kind: as a `field` of the model, a line of a `config`, a `function` to be called, or not.
        says: the field, the line, the function, or what is lost.
    """

    kind: Kind
    says: str


def way(effect: str, trainer: Trainer) -> Way:
    """How a trainer has an effect of the catalogue."""
    special = _SPECIAL.get(trainer, {}).get(effect)
    if special is not None:
        return special
    if effect in _OF_THE_LOG:
        return Way(kind="cannot", says=_OF_THE_LOG[effect])
    paths = [field.path for field in CATALOGUE[effect].fields.values()]
    laws = any(_BESIDE in path for path in paths)
    if laws:
        return Way(kind="function", says=f"`{effect}` in {MADE}")
    if trainer == "isaaclab":
        return Way(kind="field", says=f"{_first(paths)} of model.xml, before it becomes USD")
    return Way(kind="field", says=f"{_first(paths)} of model.xml")


def _first(paths: list[str]) -> str:
    known = [path.partition(" ×")[0] for path in paths if not path.startswith("actuators.json")]
    return ", ".join(f"`{path}`" for path in dict.fromkeys(known)) or "`actuator/biasprm`"


def _config(says: str) -> Way:
    return Way(kind="config", says=says)


def _cannot(says: str) -> Way:
    return Way(kind="cannot", says=says)


_GAINS = "of the actuator config"
_SPECIAL: Mapping[str, Mapping[str, Way]] = MappingProxyType(
    {
        "mjx": {
            # MJX ignores both without a word.
            "command_delay": Way(kind="function", says=f"`command_delay` in {MADE}"),
            "quadratic_drag": Way(kind="function", says=f"`quadratic_drag` in {MADE}"),
            # It would go on damping where a servo is at its limit.
            "effort_limit": Way(kind="function", says=f"`mjx_step` in {MADE}"),
        },
        "mjlab": {
            "command_delay": _config("`delay_min_lag`, `delay_max_lag`, in steps"),
            "torque_speed_limit": _config("`DcMotorActuatorCfg` in place of the XML's actuator"),
            "sensor_delay": _config("`ObservationTermCfg(delay_min_lag=…, delay_max_lag=…)`"),
            "base_tilt": _config("`MujocoCfg(gravity=…)` of the simulation"),
            "timestep": _config("`MujocoCfg(timestep=…, integrator=…)` of the simulation"),
        },
        "isaaclab": {
            "viscous_friction": _config(f"`viscous_friction` {_GAINS}"),
            "coulomb_friction": _config(f"`friction`, `dynamic_friction` {_GAINS}"),
            "armature": _config(f"`armature` {_GAINS}"),
            "position_gain": _config(f"`stiffness` {_GAINS}"),
            "velocity_gain": _config(f"`damping` {_GAINS}"),
            "effort_limit": _config(f"`effort_limit` {_GAINS}"),
            "torque_constant": _config(f"`stiffness`, `damping`, `effort_limit` {_GAINS}"),
            "encoder_gain": _config(f"`stiffness`, `damping` {_GAINS}"),
            "command_delay": _config("`DelayedPDActuatorCfg(min_delay=…, max_delay=…)`, in steps"),
            "torque_speed_limit": _config("`DCMotorCfg(saturation_effort=…, velocity_limit=…)`"),
            "torque_bias": _cannot("no constant effort; the joint sags as much less or more"),
            "quadratic_drag": Way(kind="function", says=f"`quadratic_drag` in {MADE}"),
            "parallel_spring": _cannot("joints have no springs; their effort is lost"),
            "mount_compliance": _cannot(
                "joints have no springs; without the mount's hinges it is stiff"
            ),
            "base_tilt": _config("`SimulationCfg(gravity=…)`"),
            "timestep": _config("`SimulationCfg(dt=…)`; the integrator is its own"),
            "end_stop": _cannot("the range is in model.xml; how hard its stops are is lost"),
            "ground_friction": _config("`RigidBodyMaterialCfg(static_friction=…)`"),
            "ground_compliance": _cannot("contacts are PhysX's own; how soft they are is lost"),
        },
    }
)


def table() -> str:
    """The table of docs/export.md: every effect, and every trainer."""
    rows = [["effect", *TRAINERS], ["---"] * (1 + len(TRAINERS))]
    for effect in CATALOGUE:
        cells = [f"{w.kind}: {w.says}" for w in (way(effect, one) for one in TRAINERS)]
        rows.append([f"`{effect}`", *cells])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"
