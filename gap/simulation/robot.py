"""The simulated robot: a compiled model, and how a recording's signals map onto it.

robot = load_robot("leg.xml")
robot.joints                      # names of the hinge and slide joints, in kinematic order
robot.channels(recording.joints)  # checks that they exist
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import mujoco

from walkerkit.actuators.drive import Drive, TargetKind, drives_of_joint, inputs_of_joint
from walkerkit.actuators.play_joint import play_joint
from walkerkit.gap.errors import InputError, closest, some
from walkerkit.gap.recordings.given import is_callable
from walkerkit.gap.simulation import dry_friction
from walkerkit.gap.simulation.base import Base
from walkerkit.gap.simulation.latest import Latest
from walkerkit.gap.simulation.loops import Loops
from walkerkit.gap.simulation.movers import Mover, movers, named_inputs
from walkerkit.gap.simulation.wave import Wave, WaveForm

if TYPE_CHECKING:
    from walkerkit.gap.simulation.programs import Program

_MOST_MADE = 32  # that are kept of what is made of a robot
_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, kw_only=True)
class Play:
    """The joint between a motor's joint and its link (`walkerkit.actuators.play_joint`).

    Attributes:
        name: its name in the model, may be empty.
        id: joint id.
        qpos, dof: address in qpos and qvel.
    """

    name: str
    id: int
    qpos: int
    dof: int


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A hinge or slide joint.

    Attributes:
        name: its name in the model.
        id: joint id.
        qpos, dof: address in qpos and qvel.
        drives: its actuators whose law is affine.
        slide: True for a slide joint (m, N instead of rad, N·m).
        play: what is between it and its link, where the model has play there.
        inputs: what else takes its targets: what actuators of another law take, `<dcmotor>` and
            `<pid>`, and the other targets of a law that runs in Python.
    """

    name: str
    id: int
    qpos: int
    dof: int
    drives: tuple[Drive, ...]
    slide: bool
    play: Play | None = None
    inputs: tuple[Drive, ...] = ()

    @property
    def commanded(self) -> tuple[Drive, ...]:
        """All that takes a target of it."""
        return (*self.drives, *self.inputs)

    def drive(self, kind: TargetKind) -> Drive | None:
        """What takes targets of this kind, by an affine law or one in Python, or None."""
        return next((d for d in self.commanded if d.kind == kind and d.law == "affine"), None)

    @property
    def in_python(self) -> bool:
        """Whether the law of its drive runs in Python."""
        return any(drive.in_python for drive in self.drives)

    def taker(self, kind: TargetKind) -> Drive | None:
        """What takes targets of this kind, by whatever law, or None."""
        return next((drive for drive in self.commanded if drive.kind == kind), None)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What lies between a joint and its log and MJCF cannot say; read from `actuators.json`.

    Attributes:
        position_delay: age of the logged position and velocity [s].
        effort_scale: logged effort over the effort that reaches the joint.
        effort_offset: added to the logged effort [N·m].
        encoder_gain: a, logged over true position and velocity [1].
        error_amplitude, error_periods, error_phase: A sin(N q + φ) is added to the logged position
            at q [rad, or m; per radian or metre; rad].
        clock_skew: ε, what happens t after the log's first sample is stamped t (1 + ε) [1].
        load_side: how much of the play between motor and link lies before the encoder: 0 for one
            on the motor, 1 for one on the link [1].
    """

    position_delay: float = 0.0
    effort_scale: float = 1.0
    effort_offset: float = 0.0
    encoder_gain: float = 1.0
    error_amplitude: float = 0.0
    error_periods: float = 1.0
    error_phase: float = 0.0
    clock_skew: float = 0.0
    load_side: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Excursion:
    """How far a joint went in its recordings; effects take their typical sizes from it.

    Attributes:
        lower, upper: positions [rad, or m].
        velocity: peak speed [rad/s].
        acceleration: peak acceleration [rad/s²].
        effort: peak effort, as measured, else as commanded or as the servo would make it [N·m].
        duration: of the longest recording [s].
        voltage: of the supply, its median, lowest and highest [V]; None where it was not logged.
        prominent: finds the most prominent waves of its unexplained effort over its positions.
    """

    lower: float = -1.0
    upper: float = 1.0
    velocity: float = 1.0
    acceleration: float = 10.0
    effort: float = 1.0
    duration: float = 10.0
    voltage: tuple[float, float, float] | None = None
    prominent: Callable[[], tuple[Wave, ...]] = tuple

    @property
    def range(self) -> float:
        """Width of the positions [rad]."""
        return self.upper - self.lower

    def waves(self, form: WaveForm) -> tuple[Wave, ...]:
        """The waves of one form, the most prominent first."""
        return tuple(wave for wave in self.prominent() if wave.form == form)


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A model ready for replay.

    Attributes:
        source: what the user named: a path or `package.module:callable`.
        spec: the editable model; `model` is compiled from it.
        model: the compiled model; never written to.
        joints: joint name to joint, in kinematic order.
        measurement: joint name to what is known of its measurement; absent means ideal.
        excursions: joint name to how far it went; absent means unknown.
        hold: what its targets are between samples, where that is known already.
        reads_effort_first: its log shows efforts as they were before the targets beside them acted.
        effort_age: and as of so long before the positions beside them, s; a timestep at most.
        starts_as_stepped: its log was made in steps as its own, so that replays start with the
            velocities that those steps had.
        laws: joint name to the drivetrain laws that it has beside the model, by name, each with its
            parameters.
        programs: laws of its actuators that run in Python.
        base: what floats, or None for a robot that is mounted or hung up.
        notes: what a user should know of how the model was read.
        met: pairs of kinematic trees that came near each other in the recordings; None where that
            is not known.
        finer: how many times shorter its timestep is than that of the model as it was read.
        made: what was made of it, for all who ask.
    """

    source: str
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    joints: Mapping[str, Joint]
    measurement: Mapping[str, Measurement] = field(default_factory=dict)
    excursions: Mapping[str, Excursion] = field(default_factory=dict)
    hold: Literal["zero_order", "linear", "next"] | None = None
    reads_effort_first: bool = False
    effort_age: float = 0.0
    starts_as_stepped: bool = False
    laws: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    programs: tuple[Program, ...] = ()
    base: Base | None = None
    notes: tuple[str, ...] = ()
    met: frozenset[tuple[int, int]] | None = None
    finer: float = 1.0
    made: Latest = field(
        default_factory=lambda: Latest(_MOST_MADE), init=False, repr=False, compare=False
    )

    @property
    def path(self) -> Path | None:
        """The file that the model came from, or None."""
        return None if is_callable(self.source) else Path(self.source)

    @property
    def stem(self) -> str:
        """Short name, used for the files that are written."""
        return (
            self.source.rpartition(":")[2] if is_callable(self.source) else Path(self.source).stem
        )

    @property
    def width(self) -> int:
        """How many controls it takes: MuJoCo's, and then targets of laws that run in Python."""
        inputs = sum(len(some) for one in self.programs for some in one.inputs.values())
        return int(self.model.nu) + inputs

    def number(self, joint: str, name: str) -> float | None:
        """A number of the law in Python of a joint, or None where that has none of the name."""
        for program in self.programs:
            if joint in program.joints and name in program.numbers:
                return float(program.numbers[name][program.joints.index(joint)])
        return None

    def target_range(self, joint: Joint) -> tuple[float, float]:
        """Where a joint may be and be sent [rad; m], infinite where nothing limits it."""
        model, lower, upper = self.model, -math.inf, math.inf
        if model.jnt_limited[joint.id]:
            lower, upper = map(float, model.jnt_range[joint.id])
        drive = joint.drive("position")
        if drive is not None and not drive.in_python and model.actuator_ctrllimited[drive.actuator]:
            ends = (model.actuator_ctrlrange[drive.actuator] - drive.offset) / drive.slope
            lower, upper = max(lower, float(ends.min())), min(upper, float(ends.max()))
        return lower, upper

    @property
    def has_dry_friction(self) -> bool:
        """Whether the model itself has dry friction at a joint."""
        return bool(self.model.dof_frictionloss.any())

    @property
    def movers(self) -> tuple[Mover, ...]:
        """Its actuators that are no joint's own, or take no target."""
        return self.made.get("movers", lambda: movers(self.model))

    @property
    def loops(self) -> Loops:
        """The equality constraints of its model."""
        return self.made.get("loops", lambda: Loops(self.model))

    @property
    def inputs(self) -> Mapping[str, tuple[Drive, ...]]:
        """What its actuators take that have a name, by that."""
        named = self.made.get("inputs", lambda: named_inputs(self.model))
        # A motor behind a law in Python is not sent what a log says.
        for joint in (one for one in self.joints.values() if one.in_python):
            name = self.model.actuator(joint.drives[0].actuator).name
            named = {**named, name: joint.commanded} if name else named
        return named

    def refined(
        self, factor: int, *, other_integrator: bool = False, as_dry_as_it_goes: bool = False
    ) -> Robot:
        """The same robot with a timestep that is `factor` times shorter.

        Args:
            factor: how many times.
            other_integrator: exchange implicit integration of the actuators' damping for explicit,
                or the other way round.
            as_dry_as_it_goes: its dry friction neither creeps nor lags behind a reversal.
        """
        return self.made.get(
            ("refined", factor, other_integrator, as_dry_as_it_goes),
            lambda: self._refined(factor, other_integrator, as_dry_as_it_goes),
        )

    def _refined(self, factor: int, other_integrator: bool, as_dry_as_it_goes: bool) -> Robot:
        spec = self.spec.copy()
        spec.option.timestep /= factor
        if as_dry_as_it_goes:
            for joint in spec.joints:
                if joint.frictionloss:
                    joint.solref_friction = dry_friction.reference(spec.option.timestep)
                    joint.solimp_friction = dry_friction.IMPEDANCE
        if other_integrator:
            euler = spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER
            spec.option.integrator = (
                mujoco.mjtIntegrator.mjINT_IMPLICITFAST
                if euler
                else mujoco.mjtIntegrator.mjINT_EULER
            )
        for delayed in (*spec.actuators, *spec.sensors):
            delayed.nsample *= factor
        return replace(self, spec=spec, model=spec.compile(), finer=self.finer * factor)

    def coarsened(self, factor: int) -> Robot:
        """The same robot with a timestep that is `factor` times longer."""

        def make() -> Robot:
            spec = self.spec.copy()
            spec.option.timestep *= factor
            return replace(self, spec=spec, model=spec.compile(), finer=self.finer / factor)

        return self.made.get(("coarsened", factor), make)

    def reading_earlier(self, steps: float) -> Robot:
        """The same robot, whose efforts were read before targets act, by a part of a step."""
        age = steps * float(self.model.opt.timestep)
        return replace(self, reads_effort_first=True, effort_age=age)

    @property
    def velocity_ahead(self) -> float:
        """How much earlier than its positions the velocities are that a replay starts with [s].

        MuJoCo adds to a position what its new velocity makes of a step, except in Runge and Kutta's
        steps: the slope of the positions that it makes is its velocity half a step later (leapfrog;
        Verlet, Physical Review 159, 1967).
        """
        whole = self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        return 0.0 if whole or not self.starts_as_stepped else float(self.model.opt.timestep) / 2

    def measured(self, joint: str) -> Measurement:
        """What is known of a joint's measurement."""
        return self.measurement.get(joint, Measurement())

    def excursion(self, joint: str) -> Excursion:
        """How far a joint went."""
        return self.excursions.get(joint, Excursion())

    @property
    def bodies(self) -> tuple[str, ...]:
        """Named bodies that can move, and those welded to them, in kinematic order."""
        model = self.model
        return tuple(
            model.body(body).name
            for body in range(1, model.nbody)
            if model.body_weldid[body] and model.body(body).name
        )

    def check_joints(self, names: Iterable[str], source: str) -> None:
        """Raises InputError where the model lacks one of `names`, which come from `source`."""
        known = ", ".join(map(repr, self.joints))
        names = list(names)
        if len(names) > 1 and not any(name in self.joints for name in names):
            raise InputError(
                f"{source}: none of its {len(names)} joints ({some(names)}) is in the model "
                f"{self.source}, which has {some(list(self.joints))}. It is the log of another "
                "robot, or names its joints otherwise: give the model of that robot, or rename the "
                "columns `<joint>/…`."
            )
        for name in names:
            if name not in self.joints:
                raise InputError(
                    f"{source}: joint {name!r} is not in the model {self.source}"
                    f"{closest(name, self.joints) or f', which has {known}'}. "
                    f"Rename the columns `{name}/…` or the joint, or leave them out."
                )


def scalar_joints(model: mujoco.MjModel) -> dict[str, Joint]:
    """The hinge and slide joints of a model that have a name, in kinematic order."""
    return {
        model.joint(j).name: _joint(model, j)
        for j in range(model.njnt)
        if model.jnt_type[j] in _SCALAR_JOINTS and model.joint(j).name
    }


def _joint(model: mujoco.MjModel, joint: int) -> Joint:
    play = play_joint(model, joint)
    return Joint(
        name=model.joint(joint).name,
        id=joint,
        qpos=int(model.jnt_qposadr[joint]),
        dof=int(model.jnt_dofadr[joint]),
        drives=drives_of_joint(model, joint),
        inputs=inputs_of_joint(model, joint),
        slide=bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE),
        play=None
        if play is None
        else Play(
            name=model.joint(play).name,
            id=play,
            qpos=int(model.jnt_qposadr[play]),
            dof=int(model.jnt_dofadr[play]),
        ),
    )
