"""Any robot file as a composer walker that runs its own actuators.

walker = MjcfWalker.from_file(
    "go1.xml",
    actuators=DcMotorActuatorCfg(joint_names_expr=(".*",), stiffness=40.0, damping=1.0, ...),
)
task = go_to_target.GoToTarget(walker=walker, arena=floors.Floor())   # unmodified
environment = composer.Environment(task)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_control.locomotion.walkers import base, initializers, legacy_base
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators import ActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.actuators.messages import closest, listed
from walkerkit.actuators.selection import select
from walkerkit.actuators.targeted import in_kinematic_order
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.actuated import Actuated
from walkerkit.walkers.drivetrain import Existing, Randomization
from walkerkit.walkers.robot_file import RobotFile, read_robot
from walkerkit.walkers.saved import saved_actuators

FloatArray = NDArray[np.float64]

_HOMES = ("home", "stand", "standing")
_SENSORS = ("gyro", "accelerometer", "velocimeter", "framequat")


class MjcfWalkerObservables(legacy_base.WalkerObservables):  # type: ignore[misc]
    """What the robot's own sensors tell, and what its actuators do; SI units.

    Of dm_control: `joints_pos` (n,) rad, `joints_vel` (n,) rad/s, `sensors_gyro` (3,) rad/s,
    `sensors_accelerometer` (3,) m/s², `sensors_velocimeter` (3,) m/s and `sensors_framequat` (4,),
    all in the frame of the site `imu`. m and m/s on slide joints.
    """

    @composer.observable  # type: ignore[untyped-decorator]
    def position_target(self) -> Any:
        """Position targets, (n_actuated,) rad; zeros where none is asked for."""
        return observable.Generic(self._target("position_target"))

    @composer.observable  # type: ignore[untyped-decorator]
    def velocity_target(self) -> Any:
        """Velocity targets, (n_actuated,) rad/s; zeros where none is asked for."""
        return observable.Generic(self._target("velocity_target"))

    @composer.observable  # type: ignore[untyped-decorator]
    def effort_target(self) -> Any:
        """Effort targets, (n_actuated,) N·m; zeros where none is asked for."""
        return observable.Generic(self._target("effort_target"))

    @composer.observable  # type: ignore[untyped-decorator]
    def computed_effort(self) -> Any:
        """What the actuators' laws asked for in the last physics step, (n_actuated,) N·m."""
        return observable.Generic(lambda _: self._entity.actuator_group.computed_effort)

    @composer.observable  # type: ignore[untyped-decorator]
    def applied_effort(self) -> Any:
        """What was left of it after their limits, (n_actuated,) N·m."""
        return observable.Generic(lambda _: self._entity.actuator_group.applied_effort)

    def _target(self, name: str) -> Callable[[Any], FloatArray]:
        def read(_: Any) -> FloatArray:
            target = getattr(self._entity.command, name)
            n = len(self._entity.actuator_group.joint_names)
            return np.zeros(n) if target is None else np.array(target)

        return read


class _AtHome(initializers.WalkerInitializer):  # type: ignore[misc]
    """The home pose; a robot that does not float stays where it was attached."""

    def initialize_pose(self, physics: Any, walker: Any, random_state: Any) -> None:
        """Sets joints, and the free joint where there is one."""
        del random_state
        qpos, position, quaternion = walker.upright_pose
        walker.configure_joints(physics, qpos)
        root = walker.mjcf_model
        if root.parent_model is not None and mjcf.get_frame_freejoint(root) is not None:
            walker.set_pose(physics, position=position, quaternion=quaternion)
            walker.set_velocity(physics, velocity=np.zeros(3), angular_velocity=np.zeros(3))


class MjcfWalker(Actuated, legacy_base.Walker):  # type: ignore[misc]
    """A robot that someone described in MJCF or URDF, with actuators of ours."""

    def _build(
        self,
        robot: RobotFile,
        *,
        actuators: ActuatorCfg | Iterable[ActuatorCfg],
        name: str | None = None,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        existing: Existing = "replace",
        home: str | Mapping[str, float] | ArrayLike | None = None,
        joints: Sequence[str] | None = None,
        end_effectors: Sequence[str] | None = None,
        laws: Sequence[DrivetrainLaw] = (),
        randomizations: Sequence[Randomization] = (),
        initializer: Any = None,
    ) -> None:
        """Builds the walker; `from_file` says what the arguments are."""
        super()._build(initializer=_AtHome() if initializer is None else initializer)
        root = robot.root
        self._mjcf_root = root
        if name is not None:
            root.model = name
        self._floating, self._free_joint = robot.floating, robot.free_joint
        self._root_body = robot.root_body
        names = list(robot.places)
        moving = [root.find("joint", name) for name in names]
        self._all_joints = tuple(in_kinematic_order(root, "joint"))
        self._observable_joints = (
            tuple(moving)
            if joints is None
            else tuple(moving[i] for i in select(joints, names, field="joints"))
        )
        self._end_effectors = _end_effectors(root, end_effectors)
        for effector in self._end_effectors:
            # dm_control adds a sensor of this name, which a file that was a walker has already.
            sensor = root.find("sensor", f"{effector.name}_end_effector")
            if sensor is not None:
                sensor.remove()
        self._upright = self._home_pose(robot, home, names)
        self._add_senses()
        self.put_on(
            root,
            actuators,
            action=action,
            default={name: float(self._upright.qpos[at]) for name, at in robot.places.items()},
            existing=existing,
            laws=laws,
            randomizations=randomizations,
            keep_integrator=robot.integrator is not None,
        )

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
        *,
        name: str | None = None,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        existing: Existing = "replace",
        home: str | Mapping[str, float] | ArrayLike | None = None,
        root_body: str | None = None,
        joints: Sequence[str] | None = None,
        end_effectors: Sequence[str] | None = None,
        floating: bool | None = None,
        laws: Sequence[DrivetrainLaw] = (),
        randomizations: Sequence[Randomization] = (),
        initializer: initializers.WalkerInitializer | None = None,
    ) -> Self:
        """A walker from a robot file.

        Args:
            path: an MJCF or URDF file.
            actuators: configs of its actuators; `Xml…` configs take over what the file has. By
                default those that the file has, with all that the gap workflow's `actuators.json`
                beside it says of them, drivetrain laws included (`walkers.saved`). What drives
                tendons and sites, or takes no target, is kept as it is.
            name: the walker's name, its prefix in an arena; by default the model's.
            action: action terms (`walkers.actions`); by default an action in [-1, 1] spans what
                each joint can do.
            existing: `replace` the file's actuators of these joints, or `keep` them, which makes
                joints that have one an error. Those of other joints stay, and take the last numbers
                of an action.
            home: the pose in which it starts and which its default targets hold: a keyframe's name,
                {joint: position} or all positions [rad; m]; by default the keyframe `home`,
                `stand`, or the first, else the reference pose.
            root_body: name of the body that carries it; by default the one with a free joint, else
                the first.
            joints: full-match expressions of the joints to observe; by default hinges and slides.
            end_effectors: full-match expressions of the bodies that touch the ground; by default
                those without children.
            floating: whether it gets a free joint in an arena; by default as in the file.
            laws: drivetrain laws of its joints (`walkerkit.actuators.drivetrain`), beside those
                that are saved with it.
            randomizations: what changes its actuators at the start of each episode.
            initializer: dm_control's, for another pose at the start than the one of `home`.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: it cannot be read, or an expression or name matches nothing in it.
        """
        robot = read_robot(path, root_body=root_body, floating=floating)
        if actuators is None:
            saved = saved_actuators(path, joints=robot.places)
            actuators, laws = saved.actuators, (*saved.laws, *laws)
            if not actuators:
                existing = "keep"  # nothing of ours: an action is their controls
        return cls(
            robot,
            actuators=actuators,
            name=name,
            action=action,
            existing=existing,
            home=home,
            joints=joints,
            end_effectors=end_effectors,
            laws=laws,
            randomizations=randomizations,
            initializer=initializer,
        )

    # Building.

    def _home_pose(self, robot: RobotFile, home: Any, names: Sequence[str]) -> base.WalkerPose:
        keyframes = robot.keyframes
        key = ""
        if isinstance(home, str):
            if home not in keyframes:
                known = [name for name in keyframes if name]
                raise ValueError(
                    f"home={home!r}: the file has no such keyframe{closest(home, known)}; it has "
                    f"{listed(known)}"
                )
            key = home
        elif home is None:
            named = [name for name in keyframes if name]
            key = next((name for name in _HOMES if name in keyframes), (named or [""])[0])
        qpos = keyframes[key].copy()
        if isinstance(home, Mapping):
            for name, position in home.items():
                if name not in robot.places:
                    raise ValueError(
                        f"home: there is no hinge or slide joint {name!r}{closest(name, names)}"
                    )
                qpos[robot.places[name]] = position
        elif home is not None and not isinstance(home, str):
            given = np.asarray(home, dtype=np.float64)
            if given.shape != qpos.shape:
                raise ValueError(
                    f"home should be {len(qpos)} positions, of {list(names)} and of ball joints, "
                    f"got {home!r}"
                )
            qpos = given.copy()
        if isinstance(home, Mapping) or (home is None and not key):
            self._follow(robot, qpos, home or {})
        if not np.isfinite(qpos).all():
            raise ValueError(f"home should be finite positions, got {home!r}")
        position, quaternion = robot.poses.get(key, (np.zeros(3), np.array([1.0, 0, 0, 0])))
        return base.WalkerPose(qpos=qpos, xpos=position, xquat=quaternion)

    def _follow(self, robot: RobotFile, qpos: FloatArray, given: Mapping[str, float]) -> None:
        """Puts joints that follow another where that one has them, but those that are given."""
        places, reference = robot.places, robot.keyframes[""]
        constraints = [one for one in robot.root.find_all("equality") if one.tag == "joint"]
        for _ in constraints:  # one may follow another that follows
            for one in constraints:
                follower = one.joint1.name
                if one.active is False or follower in given or follower not in places:
                    continue
                driver = None if one.joint2 is None else places.get(one.joint2.name)
                moved = 0.0 if driver is None else qpos[driver] - reference[driver]
                way = np.polynomial.Polynomial([0, 1] if one.polycoef is None else one.polycoef)
                qpos[places[follower]] = reference[places[follower]] + way(moved)

    def _add_senses(self) -> None:
        """An inertial unit and a camera at the root, where the file has none."""
        root, body = self._mjcf_root, self._root_body
        site = root.find("site", "imu") or body.add("site", name="imu", size=[0.01], group=5)
        for kind in _SENSORS:
            if getattr(root.sensor, kind):
                continue
            free = root.find("sensor", kind) is None
            name = kind if free else f"imu_{kind}"
            if kind == "framequat":
                root.sensor.add(kind, name=name, objtype="site", objname=site)
            else:
                root.sensor.add(kind, name=name, site=site)
        self._camera = root.find("camera", "egocentric") or body.add(
            "camera", name="egocentric", xyaxes=[0, -1, 0, 0, 0, 1], fovy=80
        )

    # What composer and its tasks look for.

    def _build_observables(self) -> MjcfWalkerObservables:
        return MjcfWalkerObservables(self)

    def create_root_joints(self, attachment_frame: Any) -> None:
        """Adds the free joint of a robot that floats.

        Args:
            attachment_frame: what `arena.attach(walker)` returned.
        """
        if self._floating and self._free_joint:
            attachment_frame.add("joint", type="free", **self._free_joint)
        elif self._floating:
            attachment_frame.add("freejoint")

    def reinitialize_pose(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Puts it in its home pose, at rest.

        Args:
            physics: the compiled model.
            random_state: for initializers that draw.
        """
        super().reinitialize_pose(physics, random_state)
        physics.bind(self._all_joints).qvel = 0.0

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Forgets the last episode, and takes the home pose where the task gave it none."""
        joints = physics.bind(self._all_joints)
        if np.array_equal(joints.qpos, joints.qpos0):
            self._go_home(physics, random_state)
        super().initialize_episode(physics, random_state)

    def _go_home(self, physics: Any, random_state: Any) -> None:
        """Takes the home pose where it was attached, or where the task has put it."""
        root = self._mjcf_root
        attached = root.parent_model is not None
        base_joint = mjcf.get_frame_freejoint(root) if attached else None
        if base_joint is None:
            self.reinitialize_pose(physics, random_state)
            return
        bound = physics.bind(base_joint)
        reference, pose, velocity = bound.qpos0.copy(), bound.qpos.copy(), bound.qvel.copy()
        self.reinitialize_pose(physics, random_state)
        if np.array_equal(pose, reference):
            self.shift_pose(physics, position=reference[:3], quaternion=reference[3:])
        else:
            bound.qpos, bound.qvel = pose, velocity

    @property
    def floating(self) -> bool:
        """It gets a free joint in an arena."""
        return self._floating

    @property
    def home(self) -> FloatArray:
        """Positions of all joints in the home pose [rad; m], read-only."""
        return self._upright.qpos  # type: ignore[no-any-return]

    @property
    def upright_pose(self) -> base.WalkerPose:
        """The home pose as dm_control's tasks ask for it."""
        return self._upright

    @property
    def mjcf_model(self) -> Any:
        """The root of its MJCF."""
        return self._mjcf_root

    @property
    def root_body(self) -> Any:
        """The body that carries it."""
        return self._root_body

    @property
    def observable_joints(self) -> Sequence[Any]:
        """The joints that it observes, in kinematic order."""
        return self._observable_joints

    @property
    def end_effectors(self) -> Sequence[Any]:
        """The bodies that touch the ground."""
        return self._end_effectors

    @property
    def ground_contact_geoms(self) -> Sequence[Any]:
        """Geoms of the bodies that touch the ground."""
        return tuple(geom for body in self._end_effectors for geom in body.find_all("geom"))

    @property
    def egocentric_camera(self) -> Any:
        """A camera that looks ahead."""
        return self._camera

    def aliveness(self, physics: Any) -> float:
        """0 while the root body is as upright as at home, -1 when it is upside down."""
        upright = np.zeros(9)
        mujoco.mju_quat2Mat(upright, self._upright.xquat)
        now = physics.bind(self._root_body).xmat.reshape(3, 3)
        return float((now[2] @ upright.reshape(3, 3)[2] - 1.0) / 2.0)


def _found(root: Any, kind: str, name: str) -> Any:
    element = root.find(kind, name)
    if element is None:
        known = [e.name for e in root.find_all(kind) if e.name]
        raise ValueError(f"there is no {kind} {name!r}{closest(name, known)}; use {listed(known)}")
    return element


def _end_effectors(root: Any, expressions: Sequence[str] | None) -> tuple[Any, ...]:
    bodies = [body for body in root.worldbody.find_all("body") if getattr(body, "name", None)]
    if expressions is None:
        return tuple(body for body in bodies if not body.body)
    names = [body.prefixed_identifier(prefix_root=root.namescope) for body in bodies]
    return tuple(bodies[i] for i in select(expressions, names, field="end_effectors"))
