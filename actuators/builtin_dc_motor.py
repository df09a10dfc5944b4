"""MuJoCo's DC motor: winding, back-EMF, drive, heat and friction, integrated by MuJoCo.

    BuiltinDcMotorActuatorCfg(
        joint_names_expr=(".*_knee",),
        input="position",
        nominal_voltage=24.0, stall_torque=2.2, no_load_speed=390.0, gear_ratio=9.0,
        stiffness=60.0, damping=1.5, voltage_limit=24.0, current_limit=30.0,
    )

What belongs to the motor is on its shaft, in front of the gear; what belongs to the command (gains,
limits of the effort, targets) is at the joint. The element is a `<general>` one with the numbers of
MuJoCo's `<dcmotor>`, which PyMJCF does not have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.builtin import IMPLICIT
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.config_fields import choice, number
from walkerkit.actuators.dc_motor_checks import check_dc_motor
from walkerkit.actuators.dc_motor_parameters import Input, packed, winding
from walkerkit.actuators.general import add_general
from walkerkit.actuators.limits import least
from walkerkit.actuators.selection import Numbers
from walkerkit.actuators.stateful import StatefulActuator

FloatArray = NDArray[np.float64]

_MJCF_INPUT: dict[Input, str] = {
    "voltage": "voltage",
    "position": "pos",
    "velocity": "vel",
    "effort": "ff",
}


@dataclass(frozen=True, kw_only=True)
class BuiltinDcMotorActuatorCfg(TargetedActuatorCfg):
    """MuJoCo's `<dcmotor>`: τ = N K i at the joint, where R i + L di/dt = V − K N q̇.

    `input` says what the command is. With `voltage` the motor gets it as it is, **in volts, through
    `effort_target`**, the target that acts on the joint with nothing in between. With the others a
    drive works out the voltage that makes the effort τ* = kp (q* − q) + ki ∫(q* − q) − kd q̇ for
    `position`, kd (q̇* − q̇) for `velocity` and the `effort_target` itself, less kd q̇, for `effort`.
    It knows the back-EMF and the resistance of a winding at T_ref: what the motor makes is τ* until
    `voltage_limit` stops it, later with an inductance, and less of it when hot.

    The winding is given by constants (`torque_constant` or `back_emf_constant`, and `resistance`)
    or by the nominal point (`nominal_voltage`, `stall_torque`, `no_load_speed`), or mixed. What is
    None is left out of the model. Integrate it with `implicitfast` where the back-EMF is stiff.

    Attributes:
        input: `voltage`, `position`, `velocity` or `effort`.
        torque_constant: K_t [N·m/A; N/A].
        back_emf_constant: K_e [V·s/rad; V·s/m]. In SI units it is the torque constant: one of them
            will do; of two that differ MuJoCo takes the geometric mean, which conserves energy.
        resistance: R, terminal to terminal [Ω].
        nominal_voltage: voltage at which the next two were measured [V].
        stall_torque: effort of the shaft when held fast [N·m; N].
        no_load_speed: speed of the shaft without load [rad/s; m/s].
        gear_ratio: N, turns of the shaft per turn of the joint. `armature` is at the joint, N²
            times that of the rotor. On a site `gear` takes its place.
        voltage_limit: the most that the supply gives, either way [V].
        current_limit: the most that the drive lets through, either way [A].
        effort_limit: the same as an effort at the joint [N·m; N]. Cogging and friction come on top.
        current_rate_limit: how fast the current may change [A/s].
        inductance: L [H]; None for a current that follows the voltage at once.
        electrical_time_constant: L/R [s], instead of `inductance`.
        stiffness: kp at the joint [N·m/rad; N/m].
        damping: kd at the joint [N·m·s/rad; N·s/m].
        integral_gain: ki at the joint [N·m/(rad·s); N/(m·s)].
        integral_limit: the most that ∫(q* − q) grows to, either way [rad·s; m·s].
        slew_rate: how fast the drive lets the target move, in units of the target per second. It
            sets out from where the joint is at the first command after a reset.
        cogging_amplitude: A of the torque A sin(N_p φ + φ₀) that pulls the shaft, at angle φ,
            towards its poles [N·m; N].
        cogging_periodicity: N_p, poles per radian [1/rad; 1/m].
        cogging_phase: φ₀ [rad]; None for 0.
        bristle_stiffness: σ₀ of the LuGre friction of the shaft, ż = ω − σ₀ |ω| z/g(ω) and
            −σ₀ z − σ₁ ż, with g(ω) = F_C + (F_S − F_C) exp(−(ω/v_S)²) [N·m/rad; N/m].
        bristle_damping: σ₁ [N·m·s/rad; N·s/m]; None for 0.
        coulomb_friction: F_C [N·m; N].
        static_friction: F_S [N·m; N]; None for F_C.
        stribeck_velocity: v_S [rad/s; m/s].
        thermal_resistance: R_th from winding to surroundings [K/W].
        thermal_capacitance: C_th of the winding [J/K].
        thermal_time_constant: R_th C_th [s], instead of `thermal_capacitance`.
        temperature_coefficient: α of R (1 + α (T − T_ref)) [1/K]; None for copper's 0.00393.
        ambient_temperature: of the surroundings, at which a reset leaves the winding [°C]; None
            for 25.
        reference_temperature: T_ref, at which R was measured [°C]; None for 25.
    """

    input: Input = choice(*get_args(Input))
    torque_constant: Numbers | None = number(default=None, above=0)
    back_emf_constant: Numbers | None = number(default=None, above=0)
    resistance: Numbers | None = number(default=None, above=0)
    nominal_voltage: Numbers | None = number(default=None, above=0)
    stall_torque: Numbers | None = number(default=None, above=0)
    no_load_speed: Numbers | None = number(default=None, above=0)
    gear_ratio: Numbers = number(default=1.0, above=0)
    voltage_limit: Numbers | None = number(default=None, above=0)
    current_limit: Numbers | None = number(default=None, above=0)
    effort_limit: Numbers | None = number(default=None, above=0)
    current_rate_limit: Numbers | None = number(default=None, above=0)
    inductance: Numbers | None = number(default=None, above=0)
    electrical_time_constant: Numbers | None = number(default=None, above=0)
    stiffness: Numbers | None = number(default=None, at_least=0)
    damping: Numbers | None = number(default=None, at_least=0)
    integral_gain: Numbers | None = number(default=None, above=0)
    integral_limit: Numbers | None = number(default=None, above=0)
    slew_rate: Numbers | None = number(default=None, above=0)
    cogging_amplitude: Numbers | None = number(default=None, at_least=0)
    cogging_periodicity: Numbers | None = number(default=None, above=0)
    cogging_phase: Numbers | None = number(default=None)
    bristle_stiffness: Numbers | None = number(default=None, above=0)
    bristle_damping: Numbers | None = number(default=None, at_least=0)
    coulomb_friction: Numbers | None = number(default=None, above=0)
    static_friction: Numbers | None = number(default=None, above=0)
    stribeck_velocity: Numbers | None = number(default=None, above=0)
    thermal_resistance: Numbers | None = number(default=None, above=0)
    thermal_capacitance: Numbers | None = number(default=None, above=0)
    thermal_time_constant: Numbers | None = number(default=None, above=0)
    temperature_coefficient: Numbers | None = number(default=None)
    ambient_temperature: Numbers | None = number(default=None)
    reference_temperature: Numbers | None = number(default=None)

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        check_dc_motor(self.input, self.numbers(), on_site=self.transmission == "site")

    def build(self) -> BuiltinDcMotorActuator:
        """The actuator."""
        return BuiltinDcMotorActuator(self)


_TARGET: dict[Input, str] = {
    "voltage": "effort_target",
    "position": "position_target",
    "velocity": "velocity_target",
    "effort": "effort_target",
}
_SETTABLE = ("stiffness", "damping", "effort_limit", "current_limit")
_SLOTS = (
    ("slew", "slew_rate"),
    ("integral", "integral_gain"),
    ("temperature", "thermal_resistance"),
    ("bristle", "bristle_stiffness"),
    ("current", "inductance"),
    ("current", "electrical_time_constant"),
)
"""MuJoCo's order of the motor's states, each with the field that brings it along."""


class BuiltinDcMotorActuator(StatefulActuator):
    """A DC motor that MuJoCo runs.

    Its parameters, besides those of the joint: `motor_constant` K, `resistance` R, and as far as
    configured `stiffness`, `damping`, `effort_limit` and `current_limit`.
    """

    cfg: BuiltinDcMotorActuatorCfg

    def __init__(self, cfg: BuiltinDcMotorActuatorCfg):
        super().__init__(cfg)
        self._slots = tuple(state for state, field in _SLOTS if getattr(cfg, field) is not None)
        self._now: dict[str, FloatArray] = {}
        self._per_target: FloatArray = np.zeros(0)
        self._set_out: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._all_set_out = True

    def _element(self, target: Any, name: str, numbers: Mapping[str, float]) -> Any:
        del name
        cfg = self.cfg
        constant, resistance = winding(numbers)
        limit = self._force_limit(numbers, constant)
        volts = numbers.get("voltage_limit") if cfg.input == "voltage" else None
        rows = packed(numbers, constant, resistance, cfg.input)
        return add_general(
            target,
            cfg.transmission,
            gear=cfg.gear or [numbers["gear_ratio"], 0, 0, 0, 0, 0],
            input=_MJCF_INPUT[cfg.input],
            dyntype="dcmotor",
            gaintype="dcmotor",
            biastype="dcmotor",
            actearly=True,
            actdim=len(self._slots),
            **{field: row.tolist() for field, row in rows.items()},
            **_within("ctrl", volts),
            **_within("force", None if limit is None else float(limit)),
            **self._delay(target.root),
        )

    def _force_limit(self, numbers: Mapping[str, Any], constant: FloatArray) -> FloatArray | None:
        """The most that the motor makes at its shaft, None for no limit."""
        if "current_limit" in numbers:
            return np.asarray(constant * numbers["current_limit"])
        if "effort_limit" in numbers:
            return np.asarray(numbers["effort_limit"] / numbers["gear_ratio"])
        return None

    def _bind(self) -> None:
        super()._bind()
        self._set_out = np.zeros((*self.simulation.batch_shape, 1), dtype=bool)
        self._all_set_out = "slew" not in self._slots
        self._now = {name: values.copy() for name, values in self._own().items()}
        power = {"voltage": 0, "effort": -1}.get(self.cfg.input, 1)
        self._per_target = self._gear**power
        model = self.simulation.model
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER and (
            self.cfg.transmission == "joint"
        ):
            none = np.zeros(len(self.joint_names))
            drag = (self._gear * self._now["motor_constant"]) ** 2 / self._now["resistance"]
            self.warn_unstable(
                self._now.get("stiffness", none),
                drag if self.cfg.input == "voltage" else self._now.get("damping", none),
                IMPLICIT,
            )

    # The command.

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`."""
        return frozenset({_TARGET[self.cfg.input]})

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`."""
        return self.takes

    @property
    def _gear(self) -> FloatArray:
        return self._numbers["gear_ratio"]

    def _command(
        self, position: FloatArray | None, velocity: FloatArray | None, effort: FloatArray | None
    ) -> FloatArray:
        target = {"position": position, "velocity": velocity}.get(self.cfg.input, effort)
        control = np.asarray(self._per_target * np.asarray(target))
        if not self._all_set_out:
            self._set_out_from_here()
        return control

    def _asked(self, target: str) -> FloatArray:
        numbers = self._numbers
        most: FloatArray | float = np.inf
        if target == "effort_target" and self.cfg.input == "voltage":
            most = numbers.get("voltage_limit", numbers.get("nominal_voltage", np.inf))
        elif target == "effort_target":
            return self.effort_range
        elif target == "velocity_target" and "no_load_speed" in numbers:
            most = numbers["no_load_speed"] / self._gear
        return self._both_ways(most)

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`."""
        limit = self._force_limit(self._numbers, winding(self._numbers)[0])
        return least(self._both_ways(np.inf if limit is None else limit * self._gear), self._behind)

    def _both_ways(self, most: FloatArray | float) -> FloatArray:
        """±most of each joint."""
        most = np.broadcast_to(most, len(self.joint_names))
        return np.stack([-most, most], axis=-1)

    def _set_out_from_here(self) -> None:
        """Lets limited targets move off from the joint's state; MuJoCo would start from zero."""
        q, qd = self.state()
        here = {"position": q, "velocity": qd}.get(self.cfg.input, np.zeros(self.shape))
        act = self.simulation.state("act")
        at = self._act_ids[:, self._slots.index("slew")]
        act[..., at] = np.where(self._set_out, act[..., at], self._gear * here)
        self._set_out[...] = True
        self._all_set_out = True

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        super()._reset(rows, random_state)
        if "slew" in self._slots:
            self._set_out[slice(None) if rows is None else rows] = False
            self._all_set_out = False

    # States and parameters.

    @property
    def internal_state(self) -> dict[str, FloatArray]:
        """Copies of the motor's own states, those that it has, (..., n_joints) each.

        On the shaft's side: `slew` the target that the drive lets through, `integral` ∫(q* − q)
        [rad·s], `temperature` of the winding above the surroundings [K], `bristle` z [rad],
        `current` [A].
        """
        act = self.simulation.state("act")
        return {name: act[..., self._act_ids[:, i]] for i, name in enumerate(self._slots)}

    def _own(self) -> Mapping[str, FloatArray]:
        constant, resistance = winding(self._numbers)
        chosen = {name: self._numbers[name] for name in _SETTABLE if name in self._numbers}
        return {"motor_constant": constant, "resistance": resistance, **chosen}

    def _read(self, name: str) -> FloatArray:
        return self._now[name]

    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        every = np.array(np.broadcast_to(self._now[name], self.shape))
        every[slice(None) if rows is None else rows] = values
        self._now[name] = every
        numbers = {**self._numbers, **self._now}
        constant, resistance = self._now["motor_constant"], self._now["resistance"]
        ids = self._actuator_ids
        for field, row in packed(numbers, constant, resistance, self.cfg.input).items():
            self.simulation.parameter(f"actuator_{field}")[..., ids, :] = row
        limit = self._force_limit(numbers, constant)
        if limit is not None:
            ends = np.stack([-limit, limit], axis=-1)
            self.simulation.parameter("actuator_forcerange")[..., ids, :] = ends


def _within(what: str, limit: float | None) -> dict[str, Any]:
    """Attributes of `<general>` that keep its control or its force within ±limit."""
    return {} if limit is None else {f"{what}limited": True, f"{what}range": [-limit, limit]}
