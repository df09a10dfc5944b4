"""Several motors on the same joints: side by side, or through a parallel linkage.

    (ankle,) = parallel_linkage([motor, motor])  # two motors on one joint
    pitch, roll = parallel_linkage([motor, motor], [[1, 1], [1, -1]])  # a differential ankle

The Jacobian J takes joint velocities to motor velocities, θ̇ = J q̇, one row a motor. Motor torques
then act as τ = Jᵀ τ_m, and what a motor has of inertia, stiffness or damping adds the matrix
Jᵀ diag(·) J at the joints (`linkage_matrix`). An actuator per joint can only have its diagonal.

Limits:

* A linkage moves its Jacobian with the pose: give that of the pose which matters, usually standing.
* The diagonal is all where what is beside it cancels, as for the equal motors above. Else a
  `<fixed>` tendon per motor keeps the rest in MJCF: the motor's row of J as its coefficients, the
  motor's reflected inertia as its `armature`.
* A joint's limits are those with the other joints at rest and not loaded: two joints cannot both
  have all of the motors at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from walkerkit.actuators.motors.electric import ElectricActuator

FloatArray = NDArray[np.float64]


def linkage_matrix(values: ArrayLike, jacobian: ArrayLike) -> FloatArray:
    """What motors behind a linkage have of inertia, stiffness or damping, at the joints.

    Args:
        values: One number a motor, or one for all, e.g. reflected inertias [kg·m²], shape
            (n_motors,) or ().
        jacobian: Motor velocity per joint velocity, shape (n_motors, n_joints).

    Returns:
        Jᵀ diag(values) J in the same unit, shape (n_joints, n_joints), symmetric.

    Raises:
        ValueError: the shapes do not fit, a number is not finite, or no motor drives a joint.
    """
    matrix = _check_jacobian(jacobian)
    numbers = _finite("values", values)
    if numbers.shape not in ((), matrix.shape[:1]):
        raise ValueError(
            f"`values` should be one number for each of the {len(matrix)} motors (rows of "
            f"`jacobian`), got shape {numbers.shape}"
        )
    return np.asarray(matrix.T @ (np.broadcast_to(numbers, matrix.shape[:1])[:, None] * matrix))


def parallel_linkage(
    actuators: Sequence[ElectricActuator], jacobian: ArrayLike | None = None
) -> tuple[ElectricActuator, ...]:
    """One actuator per joint that stands for several motors.

    Side by side on one joint, inertia and efforts add up and the slowest motor sets the speed.
    Gains that every motor has by itself add up as the inertia does, by `linkage_matrix`.

    Args:
        actuators: The motors, each with its own gearbox.
        jacobian: Motor velocity per joint velocity, shape (n_motors, n_joints); None for motors
            side by side on one joint, a column of ones.

    Returns:
        For each joint: inertia Σ J²I, the diagonal of the inertia matrix; efforts Σ |J|·effort;
        velocity min(velocity / |J|) over the motors that move with it.

    Raises:
        TypeError: `actuators` holds something else.
        ValueError: it is empty, the shapes do not fit, or no motor drives a joint.
    """
    motors = tuple(actuators)
    if not motors:
        raise ValueError("`actuators` is empty: give the motors that drive the joint")
    for i, motor in enumerate(motors):
        if not isinstance(motor, ElectricActuator):
            raise TypeError(
                f"`actuators[{i}]` should be an ElectricActuator, got {motor!r}; of a named motor "
                "it is `MOTORS[name].actuator()`"
            )
    matrix = _check_jacobian(np.ones((len(motors), 1)) if jacobian is None else jacobian)
    if len(matrix) != len(motors):
        raise ValueError(
            f"`jacobian` should have a row for each of the {len(motors)} motors, got shape "
            f"{matrix.shape}"
        )
    return tuple(_side_by_side(motors, column) for column in np.abs(matrix).T)


def _side_by_side(motors: Sequence[ElectricActuator], ratios: FloatArray) -> ElectricActuator:
    driving = [(motor, float(ratio)) for motor, ratio in zip(motors, ratios, strict=True) if ratio]
    stalls = [
        motor.saturation_effort * ratio
        for motor, ratio in driving
        if motor.saturation_effort is not None
    ]
    return ElectricActuator(
        reflected_inertia=sum(motor.reflected_inertia * ratio**2 for motor, ratio in driving),
        velocity_limit=min(motor.velocity_limit / ratio for motor, ratio in driving),
        effort_limit=sum(motor.effort_limit * ratio for motor, ratio in driving),
        saturation_effort=sum(stalls) if len(stalls) == len(driving) else None,
    )


def _check_jacobian(jacobian: ArrayLike) -> FloatArray:
    matrix = _finite("jacobian", jacobian)
    if matrix.ndim != 2 or 0 in matrix.shape:
        raise ValueError(
            f"`jacobian` should have shape (n_motors, n_joints), got {matrix.shape}: one row a "
            "motor, one column a joint"
        )
    idle = np.flatnonzero(~matrix.any(axis=0))
    if idle.size:
        raise ValueError(
            f"column {idle[0]} of `jacobian` is zero: no motor drives that joint; leave it out"
        )
    return matrix


def _finite(name: str, values: Any) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"`{name}` should be finite, got {values!r}")
    return array
