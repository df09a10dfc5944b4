"""What people randomize most, a function each.

    rng = np.random.default_rng(0)
    randomize_pd_gains(actuators, kp_range=(0.8, 1.2), kd_range=(0.8, 1.2), random_state=rng)
    randomize_effort_limits(
        actuators, effort_limit_range=(0.7, 1.0), joint_names_expr=(".*_leg_.*",), random_state=rng
    )

All take what `Randomization` takes and promise what it promises: from the nominal value always, a
draw for each joint of each simulation, nothing impossible, nothing changed by a refusal.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from walkerkit.actuators.actuator import Actuator, Random
from walkerkit.actuators.draws import Distribution, Range
from walkerkit.actuators.group import ActuatorGroup
from walkerkit.actuators.randomization import Operation, Randomization, set_all

_ALL = (".*",)
Actuators = Actuator | ActuatorGroup


def randomize(
    actuators: Actuators,
    parameter: str,
    range: Range,
    *,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies any one parameter.

    Args:
        actuators: initialized actuators.
        parameter: as in `Randomization`, like the others.
        range: (low, high), for a Gaussian (mean, standard deviation), or a composer variation.
        random_state: where the draws come from; it goes on from call to call.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: full-match regular expressions of the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch, ids or a mask; None for all.

    Raises:
        TypeError: as `Randomization` and its `apply`.
        ValueError: likewise.
    """
    Randomization(
        parameter=parameter,
        range=range,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
    ).apply(actuators, random_state, env_ids)


def randomize_pd_gains(
    actuators: Actuators,
    *,
    kp_range: Range | None = None,
    kd_range: Range | None = None,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies stiffness and damping of the actuators, each by a draw of its own.

    Args:
        actuators: as in `randomize`, like the others.
        kp_range: of `stiffness` [N·m/rad; N/m, without unit with `scale`]; None leaves it alone.
        kd_range: of `damping` [N·m·s/rad; N·s/m, without unit with `scale`]; None leaves it alone.
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise; or both ranges are None.
    """
    ranges = {"stiffness": kp_range, "damping": kd_range}
    if kp_range is None and kd_range is None:
        raise ValueError("kp_range and kd_range are both None: give at least one, as (0.8, 1.2)")
    gains = [
        Randomization(
            parameter=name,
            range=given,
            operation=operation,
            distribution=distribution,
            joint_names_expr=joint_names_expr,
            shared=shared,
        )
        for name, given in ranges.items()
        if given is not None
    ]
    # Both are drawn before either is set: what refuses one of them leaves the other as it was.
    drawn = [gain.changes(actuators, random_state, env_ids) for gain in gains]
    for changes in drawn:
        set_all(changes, env_ids)


def randomize_effort_limits(
    actuators: Actuators,
    *,
    effort_limit_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies the most that the actuators make.

    Args:
        actuators: as in `randomize`, like the others.
        effort_limit_range: of `effort_limit` [N·m; N, without unit with `scale`].
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise.
    """
    randomize(
        actuators,
        "effort_limit",
        effort_limit_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )


def randomize_strength(
    actuators: Actuators,
    *,
    strength_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies what share of its effort a motor makes, its limits included, as heat and age do.

    Args:
        actuators: as in `randomize`, like the others.
        strength_range: of `strength`, nominally 1.
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise.
    """
    randomize(
        actuators,
        "strength",
        strength_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )


def randomize_friction(
    actuators: Actuators,
    *,
    frictionloss_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies dry friction of the joints.

    Args:
        actuators: as in `randomize`, like the others.
        frictionloss_range: of `frictionloss` [N·m; N, without unit with `scale`].
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise.
    """
    randomize(
        actuators,
        "frictionloss",
        frictionloss_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )


def randomize_armature(
    actuators: Actuators,
    *,
    armature_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies rotor inertia as the joints feel it.

    Args:
        actuators: as in `randomize`, like the others.
        armature_range: of `armature` [kg·m²; kg, without unit with `scale`].
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise.
    """
    randomize(
        actuators,
        "armature",
        armature_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )


def randomize_viscous_damping(
    actuators: Actuators,
    *,
    viscous_damping_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies damping of the joints themselves, beside that of the actuators.

    Args:
        actuators: as in `randomize`, like the others.
        viscous_damping_range: of `viscous_damping` [N·m·s/rad; N·s/m, without unit with `scale`].
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all joints of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise.
    """
    randomize(
        actuators,
        "viscous_damping",
        viscous_damping_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )


def randomize_delay(
    actuators: Actuators,
    *,
    lag_range: Range,
    random_state: Random,
    operation: Operation = "scale",
    distribution: Distribution = "uniform",
    joint_names_expr: tuple[str, ...] = _ALL,
    shared: bool = False,
    env_ids: ArrayLike | None = None,
) -> None:
    """Varies the lag of delayed actuators, which follows at their next `reset`.

    Args:
        actuators: as in `randomize`, like the others.
        lag_range: of the draws [physics steps, without unit with `scale`]. One draw moves both
            bounds of an actuator's lag; `abs` makes the lag constant in an episode.
        random_state: where the draws come from.
        operation: `scale`, `add` or `abs`.
        distribution: `uniform`, `log_uniform` or `gaussian`.
        joint_names_expr: the joints.
        shared: one draw for all actuators of a simulation.
        env_ids: simulations of the batch.

    Raises:
        TypeError: as `randomize`.
        ValueError: likewise; a lag may become negative or longer than `delay_max_lag`.
    """
    randomize(
        actuators,
        "delay",
        lag_range,
        random_state=random_state,
        operation=operation,
        distribution=distribution,
        joint_names_expr=joint_names_expr,
        shared=shared,
        env_ids=env_ids,
    )
