"""Where MuJoCo keeps the numbers of a `dcmotor` actuator.

    gainprm  R, K, α, T_ref, kp, ki, kd, V_max
    dynprm   L/R, (di/dt)_max, R_th, C_th, T_amb, σ₀, σ₁, slew, ∫e_max
    biasprm  A, N_p, φ, F_C, F_S, v_S

Read from what MuJoCo 3.17 compiles `<dcmotor>` into; the law is in its "DC Motor Model"
(mujoco.readthedocs.io, _static/dcmotor.pdf). All of it is on the motor's side of the gear.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Input = Literal["voltage", "position", "velocity", "effort"]

_LENGTH = 10  # of each of the three
_COPPER = 0.00393  # 1/K
_ROOM = 25.0  # °C


def winding(numbers: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
    """Motor constant K [N·m/A = V·s/rad] and resistance R [Ω], from either kind of datasheet.

    Args:
        numbers: fields of the config by name, numbers or arrays (..., n_joints).
    """
    given = {name: np.asarray(value, dtype=np.float64) for name, value in numbers.items()}
    if "no_load_speed" in given:
        constant = given["nominal_voltage"] / given["no_load_speed"]
    elif "torque_constant" in given and "back_emf_constant" in given:
        constant = np.asarray(np.sqrt(given["torque_constant"] * given["back_emf_constant"]))
    else:
        constant = given.get("torque_constant", given.get("back_emf_constant", np.zeros(())))
    if "stall_torque" in given:
        return constant, constant * given["nominal_voltage"] / given["stall_torque"]
    return constant, given["resistance"]


def packed(
    numbers: Mapping[str, ArrayLike], constant: FloatArray, resistance: FloatArray, input_: Input
) -> dict[str, FloatArray]:
    """The three rows of numbers.

    Args:
        numbers: fields of the config by name, numbers or arrays (..., n_joints).
        constant: K [N·m/A], like them.
        resistance: R [Ω], like them.
        input_: what the control is.

    Returns:
        `gainprm`, `dynprm` and `biasprm`, (..., 10) each.
    """

    def of(name: str, default: float = 0.0) -> FloatArray:
        return np.asarray(numbers.get(name, default), dtype=np.float64)

    gear = of("gear_ratio")
    heats = "thermal_resistance" in numbers
    time_constant = of("electrical_time_constant")
    if "inductance" in numbers:
        time_constant = of("inductance") / resistance
    capacitance = of("thermal_capacitance")
    if "thermal_time_constant" in numbers:
        capacitance = of("thermal_time_constant") / of("thermal_resistance")
    return {
        "gainprm": _row(
            resistance,
            constant,
            of("temperature_coefficient", _COPPER if heats else 0.0),
            of("reference_temperature", _ROOM if heats else 0.0),
            of("stiffness") / (gear * gear),
            of("integral_gain") / (gear * gear),
            of("damping") / (gear * gear),
            of("voltage_limit") * (input_ != "voltage"),
        ),
        "dynprm": _row(
            time_constant,
            of("current_rate_limit"),
            of("thermal_resistance"),
            capacitance,
            of("ambient_temperature", _ROOM if heats else 0.0),
            of("bristle_stiffness"),
            of("bristle_damping"),
            of("slew_rate") / gear if input_ == "effort" else of("slew_rate") * gear,
            of("integral_limit") * gear,
        ),
        "biasprm": _row(
            of("cogging_amplitude"),
            of("cogging_periodicity"),
            of("cogging_phase"),
            of("coulomb_friction"),
            of("static_friction" if "static_friction" in numbers else "coulomb_friction"),
            of("stribeck_velocity"),
        ),
    }


def _row(*entries: FloatArray) -> FloatArray:
    zeros = (0.0,) * (_LENGTH - len(entries))
    return np.stack(np.broadcast_arrays(*entries, *zeros), axis=-1)
