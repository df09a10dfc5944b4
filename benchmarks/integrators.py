"""How large the gains of a PD controller may be: explicit and native, integrator by integrator.

One joint of inertia 0.01 kg·m² at a timestep of 2 ms, nudged. Stable means that the nudge has not
grown after two seconds. The bounds are found by bisection, up to a gain of 1e7.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from dm_control import mjcf

from benchmarks import Row
from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinPdActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.actuators.stability import stability_bounds

INERTIA, TIMESTEP, SECONDS, MOST = 0.01, 0.002, 2.0, 1e7
INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")
KINDS = {"explicit": IdealPdActuatorCfg, "native": BuiltinPdActuatorCfg}


def run(*, quick: bool) -> list[Row]:
    """Bounds of the damping alone, and of the stiffness at a damping ratio of one."""
    rows = []
    for integrator in INTEGRATORS[:2] if quick else INTEGRATORS:
        for kind in KINDS:
            damping = _largest(partial(_damped, kind, integrator))
            stiffness = _largest(partial(_sprung, kind, integrator))
            rows.append(
                Row(
                    what=f"{kind}, {integrator}",
                    result=f"damping < {_said(damping)}, stiffness < {_said(stiffness)} (ζ = 1)",
                    reference=_predicted() if kind == "explicit" and integrator == "Euler" else "",
                )
            )
    return rows


def _damped(kind: str, integrator: str, damping: float) -> bool:
    return _stable(kind, integrator, 0.0, damping)


def _sprung(kind: str, integrator: str, stiffness: float) -> bool:
    return _stable(kind, integrator, stiffness, 2 * float(np.sqrt(stiffness * INERTIA)))


def _predicted() -> str:
    most_damping = float(stability_bounds(np.array(INERTIA), TIMESTEP, np.array(0.0))[0])
    root = (np.sqrt(8.0) - 2.0) / TIMESTEP  # h ω at ζ = 1
    return f"our bound: damping < {most_damping:.3g}, stiffness < {INERTIA * root**2:.0f}"


def _largest(stable: Callable[[float], bool]) -> float:
    low, high = 1e-3, MOST
    if stable(high):
        return high
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        if stable(middle):
            low = middle
        else:
            high = middle
    return low


def _said(bound: float) -> str:
    return "1e7 and more" if bound >= MOST else f"{bound:.4g}"


def _stable(kind: str, integrator: str, stiffness: float, damping: float) -> bool:
    root = mjcf.RootElement()
    root.option.timestep, root.option.integrator = TIMESTEP, integrator
    root.option.gravity = [0, 0, 0]
    body = root.worldbody.add("body")
    body.add("inertial", pos=[0, 0, 0], mass=1, diaginertia=[INERTIA] * 3)
    body.add("joint", name="joint", axis=[0, 1, 0])
    group = ActuatorGroup(
        KINDS[kind](joint_names_expr=("joint",), stiffness=stiffness, damping=damping)
    )
    group.edit_mjcf(root)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the very gains that it warns of
        group.initialize((model, data))
    nudge = 1e-3
    data.qvel[0] = nudge
    cmd = ActuatorCmd(position_target=np.zeros(1))
    for _ in range(int(SECONDS / TIMESTEP)):
        group.apply(cmd)
        mujoco.mj_step(model, data)
        if not abs(data.qvel[0]) < 10 * nudge:
            return False
    return abs(data.qvel[0]) <= nudge
