"""Native actuators with an affine law, force = g u + b₀ + b₁ length + b₂ velocity.

MuJoCo XML reference, `actuator/general`, of which `<position>`, `<velocity>` and `<motor>` are
special cases.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Rows
from walkerkit.actuators.command import TARGETS
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.limits import control_range, force_range, least, mapped, stated, unlimited
from walkerkit.actuators.native import NativeActuator

FloatArray = NDArray[np.float64]

_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE)
_FILTER_EXACT = int(mujoco.mjtDyn.mjDYN_FILTEREXACT)


Kind = Literal["position", "velocity", "effort", "pd", "unknown"]
"""What a control asks for; `unknown` until the model is compiled."""
_TAKES: dict[Kind, frozenset[str]] = {
    "position": frozenset({"position_target"}),
    "velocity": frozenset({"velocity_target"}),
    "effort": frozenset({"effort_target"}),
    "pd": frozenset(TARGETS),
    "unknown": frozenset(TARGETS),
}
_GAINS: dict[Kind, tuple[str, ...]] = {
    "position": ("stiffness", "damping"),
    "velocity": ("damping",),
    "effort": (),
    "pd": ("stiffness", "damping"),
    "unknown": (),
}


class AffineActuator(NativeActuator):
    """Controls, gains, limits and efforts of affine actuators, in units of the joint.

    Args:
        cfg: the config.
        kind: what its control asks for; `pd` is an effort to which position and velocity are added.
    """

    def __init__(self, cfg: TargetedActuatorCfg, kind: Kind):
        super().__init__(cfg)
        self._kind = kind
        self._affine_of: mujoco.MjModel | None = None
        self._own0: dict[str, FloatArray] = {}
        self._now: dict[str, FloatArray] = {}

    def _bind(self) -> None:
        super()._bind()
        model, ids = self.simulation.model, self._actuator_ids
        if self._affine_of is not model:
            outputs = model.actuator_outadr[ids]  # not the ids behind one with several
            # A site's gear is a direction; its length and force are along it.
            on_site = self.cfg.transmission == "site"
            self._gear = np.ones(len(ids)) if on_site else model.actuator_gear[outputs, 0].copy()
            self._gain0 = model.actuator_gainprm[ids, 0].copy()
            has_bias = (model.actuator_biastype[ids] == _BIAS)[:, None]
            self._bias0 = np.where(has_bias, model.actuator_biasprm[ids, :3], 0.0)
            self._slope, self._offset = self._scale(model)
            self._limits0 = self._limits(model)
            self._limited0 = model.actuator_forcelimited[ids] != 0
            self._forcerange0 = np.where(
                self._limited0[:, None], model.actuator_forcerange[ids], self._limits0
            )
            self._own0 = dict(self._own())
            self._affine_of = model
        self._ctrlrange = stated(
            model.actuator_ctrllimited, model.actuator_ctrlrange, self._ctrl_ids
        )
        self._now = {name: values.copy() for name, values in self._own0.items()}
        first = np.asarray(model.actuator_actadr[ids], dtype=np.intp)
        self._filtered, self._act_ids = first >= 0, np.maximum(first, 0)
        self._any_filtered = bool(self._filtered.any())
        self._act = np.zeros(self.shape)
        self._actrange = stated(model.actuator_actlimited, model.actuator_actrange, ids)
        self._share = _share_of_next_activation(model, ids)

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`."""
        return _TAKES[self._kind]

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`."""
        if self._kind == "pd":
            return _TAKES["position"] if self._now["stiffness"].any() else frozenset()
        return _TAKES[self._kind]

    def _command(
        self, position: FloatArray | None, velocity: FloatArray | None, effort: FloatArray | None
    ) -> FloatArray:
        if self._kind == "pd":
            control = np.zeros(self.shape) if effort is None else np.array(effort)
            if position is not None:
                control += self._now["stiffness"] * position
            if velocity is not None:
                control += self._now["damping"] * velocity
            return control
        target = {"position": position, "velocity": velocity, "effort": effort}[self._kind]
        return np.asarray(self._slope * np.asarray(target) + self._offset)

    def _look(self) -> None:
        if self._any_filtered:
            self._act = self.simulation.state("act")[..., self._act_ids]

    # Parameters.

    def _own(self) -> Mapping[str, FloatArray]:
        own = {"strength": np.ones(len(self._gear))}
        if "stiffness" in _GAINS[self._kind]:
            own["stiffness"] = -self._bias0[:, 1] * self._gear**2
        if "damping" in _GAINS[self._kind]:
            own["damping"] = -self._bias0[:, 2] * self._gear**2
        if np.isfinite(self._limits0).any():
            own["effort_limit"] = np.abs(self._limits0).max(axis=1) * np.abs(self._gear)
        return own

    def _read(self, name: str) -> FloatArray:
        return self._now[name]

    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        every = np.array(np.broadcast_to(self._now[name], self.shape))
        every[slice(None) if rows is None else rows] = values
        given = np.isfinite(every) & np.isinf(self._own0[name])
        if given.any():
            joint = self.joint_names[int(np.argwhere(given)[0, -1])]
            raise ValueError(
                f"joint {joint!r} has no {name} to change: give its actuator a forcerange or a "
                "ctrlrange, or the joint an actuatorfrcrange"
            )
        self._now[name] = every
        self._changed = True
        gain, bias, limits = self._law()
        ids = self._actuator_ids
        self.simulation.parameter("actuator_gainprm")[..., ids, 0] = gain
        self.simulation.parameter("actuator_biasprm")[..., ids, :3] = bias
        # A limit that the file states elsewhere becomes one of the force while it is another one.
        changed = np.broadcast_to((limits != self._limits0).any(axis=-1), self.shape)
        limited = self._limited0 | changed
        ends = np.where(changed[..., None], limits, self._forcerange0)
        self.simulation.parameter("actuator_forcerange")[..., ids, :] = np.where(
            limited[..., None], ends, 0.0
        )
        if not self._limited0.all():
            self.simulation.parameter("actuator_forcelimited")[..., ids] = limited

    def _law(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gain (..., n), bias (..., n, 3) and limits (..., n, 2), in the actuators' units."""
        gain, bias = self._gains()
        strength = self._now["strength"]
        limits = self._limits0
        if "effort_limit" in self._now:
            # Ranges need not lie even about zero: both ends change in the same proportion.
            ends = (self._scaled("effort_limit", end, np.zeros(len(end))) for end in limits.T)
            limits = np.stack([*ends], axis=-1)
        unlimited = np.isinf(limits)
        weaker = np.where(unlimited, 1.0, strength[..., None])
        return gain * strength, bias * strength[..., None], limits * weaker

    def _gains(self) -> tuple[FloatArray, FloatArray]:
        """Gain and bias with the present stiffness and damping."""
        gains = _GAINS[self._kind]
        if not gains:
            return self._gain0, self._bias0
        # The leading gain carries the target with it: u stays the same target at any gain.
        leading = self._ratio(gains[0])
        # One of the gains may differ between simulations while the other does not yet.
        shape = np.broadcast_shapes(*(self._now[name].shape for name in gains))
        bias = np.array(np.broadcast_to(self._bias0, (*shape, 3)))
        bias[..., 0] *= leading
        for name, column in (("stiffness", 1), ("damping", 2)):
            if name in gains:
                bias[..., column] = self._scaled(name, self._bias0[:, column], -1 / self._gear**2)
        if self._kind == "pd":
            return self._gain0, bias
        # Where it was zero there is a builtin one, whose control is in units of the joint.
        return self._scaled(gains[0], self._gain0, np.ones(len(self._gear))), bias

    def _ratio(self, name: str) -> FloatArray:
        """A parameter over its nominal value, just one where that is zero or unchanged."""
        now, nominal = self._now[name], self._own0[name]
        return np.divide(now, nominal, out=np.ones(now.shape), where=nominal != 0)

    def _scaled(self, name: str, nominal: FloatArray, unit: FloatArray) -> FloatArray:
        """What MuJoCo has for a parameter, as it is now.

        Unchanged parameters leave every bit, and a changed one is what it would be if configured.
        """
        now, own = self._now[name], self._own0[name]
        finite = np.isfinite(own)
        each = np.where(finite, unit, 1.0)
        np.divide(nominal, own, out=each, where=finite & (own != 0))
        return np.where(now == own, nominal, now * each)

    @abc.abstractmethod
    def _scale(self, model: mujoco.MjModel) -> tuple[FloatArray, FloatArray]:
        """Control per target, and control at a target of zero, (n_joints,) each."""

    # Limits and efforts.

    def _limits(self, model: mujoco.MjModel) -> FloatArray:
        """The least of what limits the force of each actuator, in its own units, (n, 2)."""
        ids = self._actuator_ids
        limits = force_range(model, ids)
        if self._kind != "effort":
            return limits
        # Its control says how much force it asks for.
        return least(mapped(control_range(model, ids), self._gain0, self._bias0[:, 0]), limits)

    def _asked(self, target: str) -> FloatArray:
        if target == "effort_target" and self._kind == "effort":
            # The target whose force it is; a bias that the drive makes besides is none of it.
            per_target = self._gain0 * self._slope
            at_zero = self._gain0 * self._offset + self._bias0[:, 0]
            return mapped(self._limits0 - at_zero[:, None], 1 / per_target)
        if target == f"{self._kind}_target":
            controls = control_range(self.simulation.model, self._actuator_ids)
            return mapped(controls - self._offset[:, None], 1 / self._slope)
        return self.effort_range if target == "effort_target" else unlimited(len(self._gear))

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`."""
        return mapped(self._limits0, self._gear)

    def _force(self) -> tuple[FloatArray, FloatArray]:
        """Force of each actuator before and after its limits, in its own units."""
        gain, bias, limits = self._law()
        control = np.clip(self._arriving, self._ctrlrange[:, 0], self._ctrlrange[:, 1])
        if self._any_filtered:
            act = self._act + self._share * (control - self._act)
            act = np.clip(act, self._actrange[:, 0], self._actrange[:, 1])
            control = np.where(self._filtered, act, control)
        length, speed = self._gear * self._q, self._gear * self._qd
        force = gain * control + bias[..., 0] + bias[..., 1] * length + bias[..., 2] * speed
        return force, np.clip(force, limits[..., 0], limits[..., 1])

    @property
    def computed_effort(self) -> FloatArray:
        """As in `Actuator`: what MuJoCo makes before `forcerange` and the joint's own limit."""
        return self._gear * self._force()[0]

    @property
    def applied_effort(self) -> FloatArray:
        """As in `Actuator`."""
        return self._gear * self._force()[1]


def _share_of_next_activation(model: mujoco.MjModel, ids: NDArray[np.intp]) -> FloatArray:
    """How far a filter is towards its control when its force is made, (n_joints,).

    Zero, but for `actearly` the step that lies ahead (MuJoCo, `mj_nextActivation`).
    """
    steps = model.opt.timestep / np.maximum(model.actuator_dynprm[ids, 0], mujoco.mjMINVAL)
    exact = model.actuator_dyntype[ids] == _FILTER_EXACT
    share = np.where(exact, -np.expm1(-steps), steps)
    return np.where(model.actuator_actearly[ids], share, 0.0)
