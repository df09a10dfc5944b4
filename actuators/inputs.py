"""Actuators of the XML with several controls for one joint, taken over as they are.

    XmlInputsActuatorCfg(joint_names_expr=("elbow",))

A joint may have a `<position>` and a `<velocity>` actuator side by side, a `<dcmotor>`, or a
`<pid>` with inputs for position, velocity and effort. Each target goes to the control that takes
it, in units of the joint; a voltage is asked for by `effort_target`, as of
`BuiltinDcMotorActuatorCfg`. Their gains are MuJoCo's and cannot be randomized; their efforts are
what MuJoCo made in the last physics step, of all of a joint's actuators together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.actuator import Random, Rows
from walkerkit.actuators.config import TargetedActuatorCfg
from walkerkit.actuators.drive import Drive, read_inputs, uncomparable
from walkerkit.actuators.limits import (
    force_range,
    least,
    mapped,
    stated,
    stated_reach,
    unlimited,
)
from walkerkit.actuators.messages import listed
from walkerkit.actuators.targeted import TargetedActuator, actuators_of, element_ids

if TYPE_CHECKING:
    from dm_control import mjcf

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Scales = Mapping[str, Mapping[str, tuple[float, float]]]

_DCMOTOR = int(mujoco.mjtDyn.mjDYN_DCMOTOR)
_SLEW = 7  # place of the limit of a target's slope in a dcmotor's dynprm
_HISTORY_HEAD = 2  # numbers before the times and values of an actuator's history
_TARGETS = ("position_target", "velocity_target", "effort_target")


def _scales(name: str, value: Any) -> Scales:
    for target, of_joints in value.items():
        if target not in _TARGETS:
            raise ValueError(f"{name} should be of some of {list(_TARGETS)}, got {target!r}")
        for joint, pair in of_joints.items():
            if len(pair) != 2 or not np.isfinite(pair).all():
                raise ValueError(f"{name}[{target!r}][{joint!r}] should be (slope, offset): {pair}")
    return {target: dict(of_joints) for target, of_joints in value.items()}


@dataclass(frozen=True, kw_only=True)
class XmlInputsActuatorCfg(TargetedActuatorCfg):
    """Takes over all of a joint's actuators that take a target, one for each kind of target.

    Attributes:
        scales: {target: {joint: (slope, offset)}}, where a control is slope · target + offset and
            not what the XML says.
    """

    scales: Scales = field(default_factory=dict, metadata={"check": _scales})

    def check(self) -> None:
        """As in `ActuatorCfg`."""
        if self.transmission != "joint":
            raise ValueError(
                f"transmission={self.transmission!r}: XmlInputsActuatorCfg takes over the "
                "actuators of joints; use an Xml… config of one kind, or keep them"
            )

    def build(self) -> XmlInputsActuator:
        """The actuator."""
        return XmlInputsActuator(self)


def target_of(drive: Drive) -> str:
    """The target that asks for what a drive takes."""
    return "effort_target" if drive.kind == "voltage" else f"{drive.kind}_target"


def first_of_each(drives: Iterable[Drive]) -> dict[str, Drive]:
    """The first drive that takes each target, in the order of `TARGETS`."""
    found: dict[str, Drive] = {}
    for drive in drives:
        found.setdefault(target_of(drive), drive)
    return {target: found[target] for target in _TARGETS if target in found}


def _actuators(drives: Mapping[str, Drive]) -> list[int]:
    """The actuators behind some drives, each once."""
    return sorted({drive.actuator for drive in drives.values()})


def _effort_range(model: mujoco.MjModel, actuator: int) -> FloatArray:
    """What one actuator of a joint makes at most, (2,) [N·m; N]."""
    known = stated_reach(model, actuator).get("effort_target")
    if known is not None:
        return known
    ids = np.array([actuator])
    gear = model.actuator_gear[model.actuator_outadr[ids], 0]
    return np.asarray(mapped(force_range(model, ids), gear)[0])


class XmlInputsActuator(TargetedActuator):
    """Several controls of each joint, in the model before."""

    cfg: XmlInputsActuatorCfg
    adds_elements = False

    def __init__(self, cfg: XmlInputsActuatorCfg):
        super().__init__(cfg)
        self._taken: tuple[str, ...] = ()
        self._beside: tuple[Any, ...] = ()
        self._ctrl: FloatArray = np.zeros(0)
        self._controls: dict[str, tuple[IntArray, FloatArray, FloatArray]] = {}
        self._drives: list[dict[str, Drive]] = []
        self._started: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._all_started = True

    # The model.

    def _element(self, target: mjcf.Element, name: str, numbers: Mapping[str, float]) -> Any:
        raise NotImplementedError  # `_elements_of` compiles once for all

    def _elements_of(
        self, targets: Mapping[str, Any], numbers: Mapping[str, FloatArray]
    ) -> tuple[Any, ...]:
        root = next(iter(targets.values())).root
        whole = root.root_model
        model = mujoco.MjModel.from_xml_string(whole.to_xml_string(), whole.get_assets())
        main, beside, kinds = [], [], {}
        for name, target in targets.items():
            elements = actuators_of(target)
            ids = element_ids(model, elements, mujoco.mjtObj.mjOBJ_ACTUATOR, root)
            owner = {int(a): element for a, element in zip(ids, elements, strict=True)}
            drives = first_of_each(d for a in owner for d in read_inputs(model, a))
            if not drives:
                what = listed(uncomparable(model, a) for a in owner) if owner else "none"
                raise ValueError(
                    f"joint_names_expr={self.cfg.joint_names_expr}: no actuator of joint {name!r} "
                    f"takes a target ({what}): leave the joint out"
                )
            kinds[name] = tuple(drives)
            used = dict.fromkeys(drive.actuator for drive in drives.values())
            main.append(owner[next(iter(used))])
            beside += [owner[a] for a in used if owner[a] is not main[-1]]
        first, taken = next(iter(kinds.items()))
        odd = next((name for name, one in kinds.items() if one != taken), None)
        if odd is not None:
            raise ValueError(
                f"joint_names_expr={self.cfg.joint_names_expr}: {first!r} takes {list(taken)} and "
                f"{odd!r} takes {list(kinds[odd])}: give each kind a config of its own"
            )
        self._taken, self._beside = taken, tuple(beside)
        return tuple(main)

    def _bind(self) -> None:
        simulation = self.simulation
        model = simulation.model
        self._drives = [
            first_of_each(
                drive
                for actuator in self._actuators_on(int(joint))
                for drive in read_inputs(model, actuator)
            )
            for joint in self._joint_ids
        ]
        self._ctrl = simulation.state("ctrl")
        self._controls = {}
        for target in self._taken:
            drives = [of_joint[target] for of_joint in self._drives]
            given = self.cfg.scales.get(target, {})
            scales = [
                given.get(name, (drive.slope, drive.offset))
                for name, drive in zip(self.joint_names, drives, strict=True)
            ]
            slope, offset = np.array(scales).T
            ids = np.array([drive.ctrl for drive in drives], dtype=np.intp)
            self._controls[target] = ids, slope, offset
        # An actuator's first control need not be the one that asks for its main target.
        self._ctrl_ids = self._controls[self._taken[0]][0]
        self._started = np.zeros((*simulation.batch_shape, 1), dtype=bool)
        self._all_started = False

    def _actuators_on(self, joint: int) -> list[int]:
        model = self.simulation.model
        ours = set(self._actuator_ids.tolist())
        ours |= set(
            element_ids(model, self._beside, mujoco.mjtObj.mjOBJ_ACTUATOR, self._root).tolist()
        )
        return [a for a in sorted(ours) if model.actuator_trnid[a, 0] == joint]

    @property
    def beside(self) -> tuple[Any, ...]:
        """As in `Actuator`."""
        return self._beside

    # Limits.

    def _asked(self, target: str) -> FloatArray:
        if target not in self._controls:
            effort = target == "effort_target"
            return self.effort_range if effort else unlimited(len(self._drives))
        model, (ids, slope, offset) = self.simulation.model, self._controls[target]
        controls = stated(model.actuator_ctrllimited, model.actuator_ctrlrange, ids)
        asked = mapped(controls - offset[:, None], 1 / slope)
        if any(drives[target].kind != "effort" for drives in self._drives):
            return asked  # a voltage is no effort
        return least(asked, self.effort_range)

    @property
    def effort_range(self) -> FloatArray:
        """As in `Actuator`: what all of a joint's actuators make together."""
        model = self.simulation.model
        total = np.array(
            [
                np.sum([_effort_range(model, one) for one in _actuators(drives)], axis=0)
                for drives in self._drives
            ]
        )
        return least(self._behind, total)

    @property
    def _behind(self) -> FloatArray:
        """What the joints let through of the efforts of their actuators [N·m; N], (n_joints, 2)."""
        model, ids = self.simulation.model, self._joint_ids
        return stated(model.jnt_actfrclimited, model.jnt_actfrcrange, ids)

    # The command.

    @property
    def takes(self) -> frozenset[str]:
        """As in `Actuator`; all of them until the model is known."""
        return frozenset(self._taken or _TARGETS)

    @property
    def needs(self) -> frozenset[str]:
        """As in `Actuator`: the others are zero where nothing is said of them."""
        return frozenset(self._taken[:1])

    @property
    def apart(self) -> frozenset[str]:
        """As in `Actuator`."""
        return frozenset(self._taken[1:])

    def control(
        self,
        position_target: FloatArray | None,
        velocity_target: FloatArray | None,
        effort_target: FloatArray | None,
    ) -> FloatArray:
        """As in `Actuator`; controls but the first of each joint are written at once."""
        given = dict(zip(_TARGETS, (position_target, velocity_target, effort_target), strict=True))
        controls = {}
        for target, (ids, slope, offset) in self._controls.items():
            asked = given[target]
            controls[target] = slope * (np.zeros(self.shape) if asked is None else asked) + offset
            if target != self._taken[0]:
                self._ctrl[..., ids] = controls[target]
        first: FloatArray = controls[self._taken[0]]
        if not self._all_started:
            self._start(controls)
        return first

    def _start(self, controls: Mapping[str, FloatArray]) -> None:
        """Lets the first controls stand for all before them, and slow targets set out from here."""
        model, simulation = self.simulation.model, self.simulation
        q, qd = self.state()
        for column, drives in enumerate(self._drives):
            for target, drive in drives.items():
                a, control = drive.actuator, controls[target][..., [column]]
                samples = int(model.actuator_history[a, 0])
                if samples:
                    history = simulation.state("history")
                    width = int(model.actuator_ctrlnum[a])
                    first = int(model.actuator_historyadr[a]) + _HISTORY_HEAD + samples
                    first += drive.ctrl - int(model.actuator_ctrladr[a])
                    places = first + width * np.arange(samples)
                    history[..., places] = np.where(self._started, history[..., places], control)
                if model.actuator_dyntype[a] == _DCMOTOR and model.actuator_dynprm[a, _SLEW]:
                    here = {"position": q, "velocity": qd}.get(drive.kind, np.zeros(self.shape))
                    act, at = simulation.state("act"), [int(model.actuator_actadr[a])]
                    act[..., at] = np.where(
                        self._started, act[..., at], drive.slope * here[..., [column]]
                    )
        self._started[...] = True
        self._all_started = True

    def _reset(self, rows: Rows, random_state: Random | None) -> None:
        del random_state
        model, act = self.simulation.model, self.simulation.state("act")
        places: list[int] = []
        for drives in self._drives:
            for actuator in _actuators(drives):
                first = int(model.actuator_actadr[actuator])
                places += range(first, first + int(model.actuator_actnum[actuator]))
        if places:
            columns = np.array(places, dtype=np.intp)
            act[(..., columns) if rows is None else np.ix_(rows, columns)] = 0.0
        self._started[slice(None) if rows is None else rows] = False
        self._all_started = False

    @property
    def holds(self) -> bool:
        """As in `Actuator`."""
        return True

    # Efforts and parameters.

    @property
    def computed_effort(self) -> FloatArray:
        """What MuJoCo made in the last physics step, before the joint's own limit [N·m; N].

        It keeps nothing from before those of the actuators.
        """
        model, force = self.simulation.model, self.simulation.state("actuator_force")
        total = np.zeros(self.shape)
        for column, drives in enumerate(self._drives):
            for actuator in _actuators(drives):
                output = int(model.actuator_outadr[actuator])
                total[..., column] += model.actuator_gear[output, 0] * force[..., output]
        return total

    @property
    def applied_effort(self) -> FloatArray:
        """As in `Actuator`."""
        low, high = self._behind.T
        effort: FloatArray = np.clip(self.computed_effort, low, high)
        return effort

    def _own(self) -> Mapping[str, FloatArray]:
        return {}

    def _read(self, name: str) -> FloatArray:
        raise KeyError(name)

    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        raise KeyError(name)
