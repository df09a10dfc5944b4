"""dm_control's suite tasks with actuators of your choice, and our robots beside them.

    from walkerkit.tasks import suite

    environment = suite.load(
        "walker", "walk", DcMotorActuatorCfg(joint_names_expr=(".*_knee", ...), ...)
    )
    environment = suite.load("walkerkit_quadruped", "stand")

The actuators' laws run before every physics step. Task, rewards, observations, time limit and the
draws of initial states are the suite's own: with actuators that do nothing to the joints, the
trajectory is the suite's bit for bit. Actions are those of the action terms, in [-1, 1], then the
controls of actuators that stay, in their own units and order.

Every domain of the suite takes actuators but `humanoid_CMU`, whose file PyMJCF cannot write back
(`with_actuators(cmu_humanoid.CMUHumanoid(), ...)` is the same robot as a composer walker), and
`dog`, whose task wants actuators with an activation.

Ours are composer environments: `walkerkit_quadruped` and `walkerkit_biped`, each with `stand`
(`tasks.Stand`) and `walk` (`tasks.TrackVelocity`).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType, SimpleNamespace
from typing import Any, Final

from dm_control import composer, mjcf
from dm_control import suite as dm_suite

from walkerkit import walkers
from walkerkit.actuators import ActuatorCfg
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.actuators.messages import closest, listed
from walkerkit.tasks.stand import Stand
from walkerkit.tasks.suite_physics import ActuatedEnvironment, actuated
from walkerkit.tasks.track_velocity import TrackVelocity
from walkerkit.walkers.actions import ActionTerm
from walkerkit.walkers.drivetrain import Drivetrain, Existing, Randomization

_TIME_LIMIT = 20.0  # s, of our own tasks
_REASONS: Final = {
    "dog": "its task asks every actuator for an activation state",
    # A default class of it has the name that PyMJCF gives to the one of the root.
    "humanoid_CMU": "PyMJCF cannot write its file back; use "
    "with_actuators(cmu_humanoid.CMUHumanoid(), ...) in a composer task",
}
"""Domains of the suite that take no actuators of ours."""
_OWN_ROBOTS: Final = {"walkerkit_biped": "Biped", "walkerkit_quadruped": "Quadruped"}
_OWN_TASKS: Final[Mapping[str, Callable[..., composer.Task]]] = {
    "stand": Stand,
    "walk": TrackVelocity,
}

TASKS_BY_DOMAIN: Final[Mapping[str, tuple[str, ...]]] = {
    **{domain: tuple(tasks) for domain, tasks in dm_suite.TASKS_BY_DOMAIN.items()},
    **{domain: tuple(_OWN_TASKS) for domain in _OWN_ROBOTS},
}
"""Names of the tasks of each domain."""


def load(
    domain_name: str,
    task_name: str,
    actuators: ActuatorCfg | Iterable[ActuatorCfg] | None = None,
    *,
    action: ActionTerm | Sequence[ActionTerm] | None = None,
    existing: Existing = "replace",
    default: Mapping[str, float] | None = None,
    laws: Sequence[DrivetrainLaw] = (),
    randomizations: Sequence[Randomization] = (),
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> Any:
    """A suite environment.

    Args:
        domain_name: a domain of `TASKS_BY_DOMAIN`.
        task_name: one of its tasks.
        actuators: configs of the robot's actuators; by default its own. Without actuators, a domain
            of the suite is what `dm_control.suite.load` makes.
        action: action terms; by default an action in [-1, 1] spans what each joint can do.
        existing: `replace` the robot's actuators of these joints, or `keep` them, which makes
            joints that have one an error. Those of other joints stay. Not for our own domains.
        default: {joint: position} of the default pose [rad; m]; others are at their reference. Not
            for our own domains, whose robots have a home pose.
        laws: drivetrain laws of the joints (`walkerkit.actuators.drivetrain`). Not for our own
            domains.
        randomizations: what changes the actuators at the start of each episode.
        task_kwargs: arguments of the task: `random` (a seed or `RandomState`) and `time_limit` [s];
            in our own domains also those of `Stand` and `TrackVelocity`.
        environment_kwargs: arguments of the environment.
        visualize_reward: colour the robot by its reward; for domains of the suite.

    Returns:
        A `dm_control.rl.control.Environment`, or a `composer.Environment` in our own domains.

    Raises:
        ValueError: there is no such domain or task, an argument is of no use there, or as
            `ActuatorGroup.edit_mjcf`.
    """
    _check_names(domain_name, task_name)
    worn = _Worn(actuators, action, existing, default, laws, randomizations)
    kwargs = dict(task_kwargs or {})
    if domain_name in _OWN_ROBOTS:
        worn.refuse(f"domain {domain_name!r}", "existing", "default", "laws")
        _refuse_unused(f"domain {domain_name!r}", visualize_reward=visualize_reward)
        return _own_environment(domain_name, task_name, worn, kwargs, environment_kwargs or {})
    if environment_kwargs is not None:
        kwargs["environment_kwargs"] = dict(environment_kwargs)
    if actuators is None:
        worn.refuse("actuators=None", "action", "existing", "default", "laws", "randomizations")
        return dm_suite.load(domain_name, task_name, kwargs, visualize_reward=visualize_reward)
    environment = _with_actuators(domain_name, task_name, worn, kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment


@dataclass(frozen=True, eq=False)
class _Worn:
    """What `load` puts on a robot, as it has them."""

    actuators: ActuatorCfg | Iterable[ActuatorCfg] | None
    action: ActionTerm | Sequence[ActionTerm] | None
    existing: Existing
    default: Mapping[str, float] | None
    laws: Sequence[DrivetrainLaw]
    randomizations: Sequence[Randomization]

    def refuse(self, where: str, *names: str) -> None:
        """Raises ValueError where one of these arguments is given."""
        given = {
            "action": self.action is not None,
            "existing": self.existing != "replace",
            "default": self.default is not None,
            "laws": bool(self.laws),
            "randomizations": bool(self.randomizations),
        }
        _refuse_unused(where, **{name: given[name] for name in names})

    def drivetrain(self, root: mjcf.RootElement) -> Drivetrain:
        """The drivetrain of a robot that wears them."""
        return Drivetrain(
            root,
            () if self.actuators is None else self.actuators,
            action=self.action,
            default=self.default,
            existing=self.existing,
            laws=self.laws,
            randomizations=self.randomizations,
        )


def _check_names(domain_name: str, task_name: str) -> None:
    """Raises ValueError where there is no such domain or task."""
    if domain_name not in TASKS_BY_DOMAIN:
        raise ValueError(
            f"there is no domain {domain_name!r}{closest(domain_name, TASKS_BY_DOMAIN)}; there are "
            f"{listed(TASKS_BY_DOMAIN, most=len(TASKS_BY_DOMAIN))}"
        )
    tasks = TASKS_BY_DOMAIN[domain_name]
    if task_name not in tasks:
        raise ValueError(
            f"domain {domain_name!r} has no task {task_name!r}{closest(task_name, tasks)}; it has "
            f"{listed(tasks)}"
        )


def _own_environment(
    domain_name: str,
    task_name: str,
    worn: _Worn,
    kwargs: dict[str, Any],
    environment_kwargs: Mapping[str, Any],
) -> composer.Environment:
    """A composer environment with a robot of ours."""
    robot = getattr(walkers, _OWN_ROBOTS[domain_name])(
        actuators=worn.actuators, action=worn.action, randomizations=worn.randomizations
    )
    options = {"strip_singleton_obs_buffer_dim": True, **environment_kwargs}
    return composer.Environment(
        time_limit=kwargs.pop("time_limit", _TIME_LIMIT),
        random_state=kwargs.pop("random", None),
        task=_OWN_TASKS[task_name](robot, **kwargs),
        **options,
    )


def _with_actuators(
    domain_name: str, task_name: str, worn: _Worn, kwargs: Mapping[str, Any]
) -> Any:
    """The suite's environment, whose robot wears actuators."""
    if domain_name in _REASONS:
        raise ValueError(
            f"domain {domain_name!r} takes no actuators of ours: {_REASONS[domain_name]}"
        )

    module = importlib.import_module(f"{dm_suite.__name__}.{domain_name}")
    make = _seeing(
        module.SUITE[task_name],
        Physics=_Maker(module.Physics, worn.drivetrain),
        control=SimpleNamespace(Environment=ActuatedEnvironment),
    )
    return make(**kwargs)


class _Maker:
    """Stands where the suite's functions look for the class of their physics."""

    def __init__(self, cls: Any, drivetrain: Callable[[mjcf.RootElement], Drivetrain]):
        self._cls = actuated(cls)
        self._drivetrain = drivetrain

    def from_xml_string(self, xml_string: str, assets: Mapping[str, bytes] | None = None) -> Any:
        """The physics of a model, with the actuators put on."""
        root = mjcf.from_xml_string(xml_string, assets=assets)
        drivetrain = self._drivetrain(root)
        physics = self._cls.from_xml_string(root.to_xml_string(), root.get_assets())
        physics.put_on(drivetrain)
        return physics


def _seeing(function: Any, **names: Any) -> Callable[..., Any]:
    """The suite's function, with other values for some names of its module.

    The functions of the suite build physics, task and environment in one go, and name the classes
    of the first and the last by globals. This gives one of them other globals, and leaves the
    module, which others use, alone.
    """
    seeing = FunctionType(
        function.__code__,
        {**function.__globals__, **names},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    seeing.__kwdefaults__ = function.__kwdefaults__
    return seeing


def _refuse_unused(where: str, **given: bool) -> None:
    for name, is_given in given.items():
        if is_given:
            raise ValueError(f"{name} is of no use with {where}: leave it out")
