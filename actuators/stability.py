"""How large the gains of an actuator may be that is integrated explicitly.

For a joint of inertia I under τ = −kp q − kd q̇, computed in Python and integrated with
semi-implicit Euler steps of length h, the characteristic polynomial of one step,

    z² − (2 − h kd/I − h² kp/I) z + (1 − h kd/I),

has both roots inside the unit circle (Jury's criterion) just when

    kd < 2 I/h    and    h² kp/I < 4 − 2 h kd/I,

the second of which is h ω < −2ζ + 2 √(ζ² + 1) with ω² = kp/I and ζ = kd/(2 I ω). Damping b of the
joint itself, which MuJoCo integrates implicitly, puts I + h b for I and kd + b for kd, so that kd
may be larger by b.

Solved for h and for I these are the timestep and the armature that would do. An actuator of
MuJoCo's under `implicitfast` bears any kd, and any kp with h ω < 2ζ + 2 √(ζ² + 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_WITHIN = 0.98  # of a bound, so that the digits that are told are within it as well


def joint_inertia(model: mujoco.MjModel, dofs: NDArray[np.intp]) -> FloatArray:
    """Inertia that an effort on each joint moves in the reference pose, the others free.

    Args:
        model: the compiled model.
        dofs: the joints' degrees of freedom.

    Returns:
        (n_joints,) [kg·m²; kg]: 1/(M⁻¹)ᵢᵢ, which is what the fastest motion of the joint feels.
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    unit = np.zeros((len(dofs), model.nv))
    unit[np.arange(len(dofs)), dofs] = 1.0
    moved = np.empty_like(unit)
    mujoco.mj_solveM(model, data, moved, unit)
    return 1.0 / moved[np.arange(len(dofs)), dofs]


def stability_bounds(
    inertia: FloatArray, timestep: float, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The largest damping, and the largest stiffness beside this damping, that stay stable.

    Args:
        inertia: I [kg·m²; kg], (n_joints,).
        timestep: h [s].
        damping: kd [N·m·s/rad; N·s/m], (n_joints,).

    Returns:
        Bounds of kd [N·m·s/rad; N·s/m] and of kp [N·m/rad; N/m], (n_joints,) each.
    """
    most_damping = 2 * inertia / timestep
    most_stiffness = np.maximum(4 * inertia / timestep - 2 * damping, 0.0) / timestep
    return most_damping, most_stiffness


def unstable_gains(
    model: mujoco.MjModel,
    names: Sequence[str],
    dofs: NDArray[np.intp],
    stiffness: FloatArray,
    damping: FloatArray,
    implicit: str | None,
) -> list[str]:
    """A sentence for each joint whose gains are beyond what its timestep bears.

    It is about actuators that the integrator treats explicitly: all laws that run in Python, and
    MuJoCo's own under Euler.

    Args:
        model: the compiled model.
        names: the joints' names.
        dofs: their degrees of freedom, (n_joints,).
        stiffness: kp [N·m/rad; N/m], (n_joints,).
        damping: kd [N·m·s/rad; N·s/m], (n_joints,).
        implicit: what has the same law integrated implicitly; None where nothing has it.
    """
    timestep = float(model.opt.timestep)
    own = model.dof_damping[dofs]
    inertia = joint_inertia(model, dofs)
    most_damping, most_stiffness = stability_bounds(inertia, timestep, damping - own)
    most_damping = most_damping + own
    problems = []
    for i, name in enumerate(names):
        kp, kd = float(stiffness[i]), float(damping[i])
        if kd >= most_damping[i]:
            also = f" + {own[i]:g} (the joint's own)" if own[i] else ""
            what = f"damping {kd:g} is beyond {most_damping[i]:.3g} = 2 I/h{also}"
        elif kp >= most_stiffness[i]:
            what = f"stiffness {kp:g} is beyond {most_stiffness[i]:.3g} beside damping {kd:g}"
        else:
            continue
        problems.append(
            f"joint {name!r}: {what}, the bound of explicit integration at inertia "
            f"{inertia[i]:.3g} kg·m² and timestep {timestep:g} s; "
            + _remedy(float(inertia[i]), timestep, kp, kd, float(own[i]), implicit)
        )
    return problems


def _remedy(
    inertia: float, timestep: float, kp: float, kd: float, own: float, implicit: str | None
) -> str:
    """What mends it, of which each is enough by itself."""
    net = kd - own
    longest = 2 * inertia / net if net > 0 else math.inf
    if kp > 0:
        longest = min(longest, (math.sqrt(net**2 + 4 * inertia * kp) - net) / kp)
    shorter = f"a timestep of {_WITHIN * longest:.3g} s"
    if implicit is not None and kp < 4 * inertia / timestep**2 + 2 * (kd + own) / timestep:
        return f"use {implicit}, {shorter}, or smaller gains"
    needed = max(net * timestep / 2, kp * timestep**2 / 4 + net * timestep / 2)
    heavier = f"armature, if its motor has it ({(needed - inertia) / _WITHIN:.3g} kg·m² more)"
    why = ": no integrator helps a law that runs in Python" if implicit is None else ""
    return f"use {shorter}, more {heavier}, or smaller gains{why}"
