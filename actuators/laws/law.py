"""A law: joint effort from targets, position and velocity.

Each law is a pure function over arrays `(..., n_joints)`, written out in its own module, and a
class that holds the function's parameters, scratch memory and state for one set of joints.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.command import TARGETS

FloatArray = NDArray[np.float64]
Target = FloatArray | None


class Law(abc.ABC):
    """Parameters and state of one law for n joints.

    Args:
        parameters: by name, (n_joints,) each.
    """

    joinable: ClassVar[bool] = False
    """Each joint by itself and without a past: one law of the class can stand for several."""
    takes: frozenset[str] = frozenset(TARGETS)
    needs: frozenset[str] = frozenset()

    def __init__(self, parameters: Mapping[str, FloatArray]):
        self._parameters = {name: np.array(value) for name, value in parameters.items()}
        self._shape: tuple[int, ...] = ()

    def allocate(self, shape: tuple[int, ...]) -> None:
        """Makes room for arrays of this shape, (n_joints,) or (n_sims, n_joints), state at rest."""
        self._shape = shape
        self._allocate(shape)
        self._refresh()
        if not type(self).__module__.startswith("walkerkit."):
            self._try_out()

    def _try_out(self) -> None:
        """Runs a law of a user's own once, so that its first error says what is wrong with it.

        Raises:
            ValueError: it raises, writes to what it is given, or returns no two arrays of numbers.
        """
        name = f"{type(self).__module__}.{type(self).__qualname__}.effort"
        still = np.zeros(self._shape)
        still.flags.writeable = False
        position, velocity, effort = (still if one in self.takes else None for one in TARGETS)
        self.reset(None)
        try:
            made = self.effort(position, velocity, effort, still, still)
        except Exception as error:  # a user's function may raise anything
            raise ValueError(f"{name} raised {type(error).__name__}: {error}") from error
        self.reset(None)
        wanted = (
            f"two new arrays of floats of shape {self._shape}: the effort that it asks for, and "
            "what its limits leave of it"
        )
        if not isinstance(made, tuple | list) or len(made) != 2:
            raise ValueError(f"{name} returned {_kind(made)}; it should return {wanted}")
        for one in made:
            if not isinstance(one, np.ndarray) or one.shape != self._shape or one.dtype.kind != "f":
                raise ValueError(f"{name} returned {_kind(one)} in it; it should return {wanted}")
            if not np.isfinite(one).all():
                raise ValueError(
                    f"{name} returned {one} for targets, positions and velocities of zero; it "
                    "should return finite numbers"
                )

    def get(self, name: str) -> FloatArray:
        """A parameter, (n_joints,) or (n_sims, n_joints)."""
        return self._parameters[name]

    def set(self, name: str, values: FloatArray, rows: NDArray[np.intp] | None) -> None:
        """Changes a parameter, of all simulations or of some rows."""
        if rows is None:
            self._parameters[name] = np.array(values)
        else:
            every = np.array(np.broadcast_to(self._parameters[name], self._shape))
            every[rows] = values
            self._parameters[name] = every
        self._refresh()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self._parameters)

    @abc.abstractmethod
    def effort(
        self, position: Target, velocity: Target, effort: Target, q: FloatArray, qd: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The effort that the law asks for, and what its limits leave of it; new arrays.

        Args:
            position: position targets [rad; m], (..., n_joints), or None.
            velocity: velocity targets [rad/s; m/s], or None.
            effort: effort targets [N·m; N], or None.
            q: positions [rad; m].
            qd: velocities [rad/s; m/s].
        """

    def reset(self, rows: NDArray[np.intp] | None) -> None:  # noqa: B027  most have no state
        """Forgets the past of all simulations or of some rows."""

    def _allocate(self, shape: tuple[int, ...]) -> None:  # noqa: B027
        """Makes room for state and scratch."""

    def _refresh(self) -> None:  # noqa: B027
        """Works out what follows from parameters that changed."""


def _kind(value: object) -> str:
    """What a value is, for a message."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and {value.dtype}"
    if isinstance(value, tuple | list):
        return f"a {type(value).__name__} of {len(value)}"
    return f"a {type(value).__name__}" if value is not None else "None"
