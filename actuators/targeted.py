"""An actuator of the joints, tendons or sites that its config names."""

from __future__ import annotations

import abc
import re
import warnings
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.actuator import Actuator, Rows, rows_of, unknown_parameter
from walkerkit.actuators.config import JOINT_ATTRIBUTES, TargetedActuatorCfg
from walkerkit.actuators.limits import least, length_range
from walkerkit.actuators.messages import listed
from walkerkit.actuators.selection import per_joint, select
from walkerkit.actuators.simulation import Simulation, viewed
from walkerkit.actuators.stability import unstable_gains

if TYPE_CHECKING:
    from dm_control import mjcf

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_OBJECT = {
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "site": mujoco.mjtObj.mjOBJ_SITE,
}
_REFERENCES = {"joint": "joint", "jointinparent": "joint", "tendon": "tendon", "site": "site"}
"""Attributes of an actuator that say what it drives, and the kinds of these."""
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_MODEL_FIELD = {
    "joint": {
        "armature": "dof_armature",
        "frictionloss": "dof_frictionloss",
        "viscous_damping": "dof_damping",
    },
    "tendon": {
        "armature": "tendon_armature",
        "frictionloss": "tendon_frictionloss",
        "viscous_damping": "tendon_damping",
    },
    "site": {},
}


class TargetedActuator(Actuator):
    """Finds its joints, in the text and in the compiled model; subclasses add the law.

    Args:
        cfg: the config.
    """

    def __init__(self, cfg: TargetedActuatorCfg):
        super().__init__()
        self.cfg = cfg
        self._root: Any = None
        self._targets: list[Any] = []
        self._elements: tuple[Any, ...] = ()
        self._joint_names: tuple[str, ...] = ()
        self._numbers: dict[str, FloatArray] = {}
        self._simulation: Simulation | None = None
        self._joint_ids: IntArray = np.zeros(0, dtype=np.intp)
        self._actuator_ids: IntArray = np.zeros(0, dtype=np.intp)
        self._ctrl_ids: IntArray = np.zeros(0, dtype=np.intp)
        self._length: tuple[FloatArray, Any] = (np.zeros(0), ...)
        self._speed: tuple[FloatArray, Any] = (np.zeros(0), ...)
        self._nominal_of: mujoco.MjModel | None = None
        self._nominal: dict[str, FloatArray] = {}

    # What subclasses say.

    adds_elements: ClassVar[bool] = True
    """It adds actuators to the model, instead of working through those that are there."""

    @abc.abstractmethod
    def _element(self, target: mjcf.Element, name: str, numbers: Mapping[str, float]) -> Any:
        """Adds (or finds) MuJoCo's actuator of one target, of which `numbers` has the config's."""

    @abc.abstractmethod
    def _bind(self) -> None:
        """Makes ready for the compiled model and the batch's shape."""

    @abc.abstractmethod
    def _own(self) -> Mapping[str, FloatArray]:
        """The law's own parameters as configured, each (n_joints,)."""

    @abc.abstractmethod
    def _read(self, name: str) -> FloatArray:
        """One of the law's own parameters as it is now, (n_joints,) or (n_sims, n_joints)."""

    @abc.abstractmethod
    def _write(self, name: str, values: FloatArray, rows: Rows) -> None:
        """Changes one of the law's own parameters."""

    @abc.abstractmethod
    def _asked(self, target: str) -> FloatArray:
        """`reach` as the law and the control have it, (n_joints, 2)."""

    # Lifecycle.

    def targets(self, root: mjcf.RootElement) -> list[mjcf.Element]:
        """As in `Actuator`."""
        return list(self._plan(root)[0].values())

    def edit_mjcf(self, root: mjcf.RootElement) -> None:
        """As in `Actuator`."""
        targets, numbers = self._plan(root)
        for i, target in enumerate(targets.values()):
            for name, attribute in JOINT_ATTRIBUTES.items():
                if name in numbers:
                    setattr(target, attribute, float(numbers[name][i]))
        self._elements = self._elements_of(targets, numbers)
        self._root, self._numbers = root, numbers
        self._targets, self._joint_names = list(targets.values()), tuple(targets)

    def _plan(self, root: mjcf.RootElement) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Its targets by name, and its numbers; every refusal comes before the first edit."""
        kind = self.cfg.transmission
        named = candidates(root, kind)
        if not named:
            raise ValueError(
                f"joint_names_expr={self.cfg.joint_names_expr}: the model {root.model!r} has no "
                f"{'hinge or slide joint' if kind == 'joint' else kind} with a name"
            )
        names = list(named)
        names = [names[i] for i in select(self.cfg.joint_names_expr, names)]
        chosen = list(range(len(names)))
        if self.adds_elements and kind == "joint":
            following = _following(root, self.cfg.joint_names_expr)
            chosen = [i for i in chosen if names[i] not in following]
        targets = {names[i]: named[names[i]] for i in chosen}
        numbers = {
            name: per_joint(value, names, field=name)[chosen]
            for name, value in self.cfg.numbers().items()
        }
        if self.adds_elements:
            self._refuse_taken(targets)
        else:
            self._elements_of(targets, numbers)
        return targets, numbers

    def _elements_of(
        self, targets: Mapping[str, Any], numbers: Mapping[str, FloatArray]
    ) -> tuple[Any, ...]:
        return tuple(
            self._element(target, name, {key: float(one[i]) for key, one in numbers.items()})
            for i, (name, target) in enumerate(targets.items())
        )

    def _refuse_taken(self, targets: Mapping[str, Any]) -> None:
        """Refuses joints that have an actuator already."""
        for name, target in targets.items():
            taken = actuators_of(target)
            if taken:
                raise ValueError(
                    f"joint_names_expr={self.cfg.joint_names_expr}: {self.cfg.transmission} "
                    f"{name!r} already has the actuator {listed(str(e.name) for e in taken)}: "
                    "remove that from the model, wrap it with an Xml… config, or leave the joint "
                    "out; two would push against each other"
                )

    def initialize(self, physics: Any) -> None:
        """As in `Actuator`."""
        if not self._elements:
            raise RuntimeError(
                f"the actuator of {self.cfg.joint_names_expr} has no joints yet: call "
                "edit_mjcf(root) before the model is compiled"
            )
        simulation = Simulation.of(physics)
        model = simulation.model
        kind = self.cfg.transmission
        self._joint_ids = element_ids(model, self._targets, _OBJECT[kind], self._root)
        self._actuator_ids = element_ids(
            model, self._elements, mujoco.mjtObj.mjOBJ_ACTUATOR, self._root
        )
        self._ctrl_ids = model.actuator_ctrladr[self._actuator_ids].astype(np.intp)
        if kind == "joint":
            for name, joint in zip(self._joint_names, self._joint_ids, strict=True):
                if int(model.jnt_type[joint]) not in _SCALAR:
                    raise ValueError(
                        f"joint {name!r} is neither hinge nor slide: it has no single position; "
                        "leave it out of joint_names_expr"
                    )
            self._length = simulation.state("qpos"), model.jnt_qposadr[self._joint_ids]
            self._speed = simulation.state("qvel"), model.jnt_dofadr[self._joint_ids]
        elif kind == "tendon":
            self._length = simulation.state("ten_length"), self._joint_ids
            self._speed = simulation.state("ten_velocity"), self._joint_ids
        else:
            outputs = model.actuator_outadr[self._actuator_ids]
            self._length = simulation.state("actuator_length"), outputs
            self._speed = simulation.state("actuator_velocity"), outputs
        self._length = viewed(*self._length)
        self._speed = viewed(*self._speed)
        self._simulation = simulation
        self._checked = None
        self._bind()
        if self._nominal_of is model:
            # What the model holds by now may be random: back to what it was compiled with.
            for name, value in self._nominal.items():
                self.set(name, value)
        else:
            fields = _MODEL_FIELD[kind]
            self._nominal = {
                **{name: getattr(model, field)[self._places] for name, field in fields.items()},
                **{name: np.array(value) for name, value in self._own().items()},
            }
            self._nominal_of = model

    def warn_unstable(
        self, stiffness: FloatArray, damping: FloatArray, implicit: str | None
    ) -> None:
        """Warns of gains that explicit integration does not bear.

        Args:
            stiffness: kp [N·m/rad; N/m], (n_joints,).
            damping: kd [N·m·s/rad; N·s/m], (n_joints,).
            implicit: as in `unstable_gains`.
        """
        model, places = self.simulation.model, self._places
        for problem in unstable_gains(
            model, self._joint_names, places, stiffness, damping, implicit
        ):
            warnings.warn(problem, UserWarning, stacklevel=2)

    # State and properties.

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of its joints, (..., n_joints) each, perhaps live views."""
        (q, at), (qd, dof) = self._length, self._speed
        return (q if at is None else q[at]), (qd if dof is None else qd[dof])

    @property
    def positions(self) -> FloatArray:
        """As in `Actuator`."""
        return self.state()[0]

    def reach(self, target: str) -> FloatArray:
        """As in `Actuator`."""
        asked = self._asked(target)
        if target != "position_target":
            return asked
        model = self.simulation.model
        return least(asked, length_range(model, self.cfg.transmission, self._joint_ids))

    @property
    def simulation(self) -> Simulation:
        """As in `Actuator`."""
        if self._simulation is None:
            raise self._unknown()
        return self._simulation

    def _unknown(self) -> RuntimeError:
        """The error for who asks before it knows its physics."""
        first = "" if self._elements else "edit_mjcf(root) before the model is compiled, then "
        return RuntimeError(
            f"the actuator of {self.cfg.joint_names_expr} does not know its physics: call "
            f"{first}initialize(physics) after the model was compiled"
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its arrays: (n_joints,) or (n_sims, n_joints)."""
        return (*self.simulation.batch_shape, len(self._joint_names))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """As in `Actuator`."""
        return self._joint_names

    @property
    def joint_ids(self) -> IntArray:
        """As in `Actuator`."""
        return self._known(self._joint_ids)

    @property
    def ctrl_ids(self) -> IntArray:
        """As in `Actuator`."""
        return self._known(self._ctrl_ids)

    def _known(self, ids: IntArray) -> IntArray:
        """The ids, once there is a model that they are of."""
        if self._simulation is None:
            raise self._unknown()
        return ids

    @property
    def numbers(self) -> Mapping[str, FloatArray]:
        """The config's numbers for its joints, (n_joints,) each."""
        return self._numbers

    @property
    def elements(self) -> tuple[Any, ...]:
        """As in `Actuator`."""
        return self._elements

    # Parameters.

    @property
    def parameters(self) -> tuple[str, ...]:
        """As in `Actuator`."""
        return tuple(self._nominal)

    def nominal(self, name: str) -> FloatArray:
        """As in `Actuator`."""
        if name not in self._nominal:
            raise unknown_parameter(name, self.parameters)
        return self._nominal[name].copy()

    def get(self, name: str) -> FloatArray:
        """As in `Actuator`."""
        if name not in self._nominal:
            raise unknown_parameter(name, self.parameters)
        field = _MODEL_FIELD[self.cfg.transmission].get(name)
        if field is None:
            values = self._read(name)
        else:
            values = self.simulation.parameter(field)[..., self._places]
        return np.broadcast_to(values, self.shape).copy()

    def set(self, name: str, values: ArrayLike, env_ids: ArrayLike | None = None) -> None:
        """As in `Actuator`."""
        if name not in self._nominal:
            raise unknown_parameter(name, self.parameters)
        rows = rows_of(env_ids, self.simulation.batch_shape)
        n_rows = self.shape[:-1] if rows is None else (len(rows),)
        given = np.broadcast_to(np.asarray(values, dtype=np.float64), (*n_rows, self.shape[-1]))
        field = _MODEL_FIELD[self.cfg.transmission].get(name)
        if field is None:
            self._write(name, given, rows)
            return
        at = (..., self._places) if rows is None else np.ix_(rows, self._places)
        self.simulation.parameter(field)[at] = given
        self.simulation.commit(field, rows=None if rows is None else np.unique(rows))

    @property
    def _places(self) -> IntArray:
        """Where the joints are in the model fields that hold their armature and friction."""
        if self.cfg.transmission == "joint":
            return np.asarray(self.simulation.model.jnt_dofadr[self._joint_ids], dtype=np.intp)
        return self._joint_ids


def drivers(root: mjcf.RootElement) -> dict[str, str]:
    """The joints that follow another by an equality constraint, each with the one it follows."""
    return {
        one.joint1.prefixed_identifier(prefix_root=root.namescope): (
            one.joint2.prefixed_identifier(prefix_root=root.namescope)
        )
        for one in root.find_all("equality")
        if one.tag == "joint" and one.joint2 is not None and one.active is not False
    }


def _following(root: mjcf.RootElement, expressions: Iterable[str]) -> set[str]:
    """The joints that an expression matches beside the one that they follow.

    One degree of freedom takes one drive: two would push against each other.
    """
    return {
        follower
        for follower, driver in drivers(root).items()
        for expression in expressions
        if re.fullmatch(expression, follower) and re.fullmatch(expression, driver)
    }


def actuators_of(target: mjcf.Element) -> list[Any]:
    """MuJoCo's actuators that drive a joint, tendon or site, in the order of the model.

    Those count, too, that belong to a model to which the target's is attached.
    """
    return [
        element
        for element in target.root.root_model.find_all("actuator")
        if any(_refers(element, reference, target) for reference in _REFERENCES)
    ]


def _refers(element: mjcf.Element, reference: str, target: mjcf.Element) -> bool:
    value = getattr(element, reference, None)
    if isinstance(value, str):  # as it stays where it was given by name
        value = element.root.find(_REFERENCES[reference], value)
    return value is target


def element_ids(
    model: mujoco.MjModel, elements: Iterable[Any], kind: mujoco.mjtObj, root: mjcf.RootElement
) -> IntArray:
    """Where elements of a robot's text are in a compiled model.

    Args:
        model: compiled from the robot's own root, or from an arena to which it is attached.
        elements: of one kind.
        kind: what they are.
        root: the robot's own root.

    Raises:
        ValueError: the model does not have one of them.
    """
    ids = []
    for element in elements:
        full = element.full_identifier
        found = mujoco.mj_name2id(model, kind, full)
        if found < 0:
            # Compiled from the walker's own root, although it is attached to another.
            own = element.prefixed_identifier(prefix_root=root.namescope)
            found = mujoco.mj_name2id(model, kind, own)
        if found < 0:
            raise ValueError(
                f"the compiled model has no {element.tag} {full!r}: compile the model that "
                "edit_mjcf was called on, or the arena to which it is attached"
            )
        ids.append(found)
    return np.array(ids, dtype=np.intp)


def in_kinematic_order(root: mjcf.RootElement, kind: str) -> list[Any]:
    """Every joint, tendon or site of a model, in the order of the compiled model."""
    return root.tendon.find_all(kind) if kind == "tendon" else _below(root.worldbody, kind)


def _below(body: Any, kind: str) -> list[Any]:
    """A body's own come first, wherever the text has them among its child bodies."""
    own: list[Any] = body.find_all(kind, immediate_children_only=True)
    for child in body.find_all("body", immediate_children_only=True):
        own += _below(child, kind)
    return own


def candidates(root: mjcf.RootElement, kind: str) -> dict[str, Any]:
    """Everything of a kind that has a name, by name, in kinematic order."""
    # A free joint is a joint of another tag, or of a type that a default class may also give: what
    # the text cannot tell is told after compilation.
    return {
        element.prefixed_identifier(prefix_root=root.namescope): element
        for element in in_kinematic_order(root, kind)
        if getattr(element, "name", None)
        and (kind != "joint" or (element.tag == "joint" and element.type not in ("free", "ball")))
    }
