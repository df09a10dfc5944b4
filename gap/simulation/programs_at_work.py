"""The laws in Python of many simulations at once, each with numbers of its own.

at_work = ProgramsAtWork(trials, n_segments, columns)
running = at_work.start(model)                    # with nothing to remember yet
controls = running.controls(sent, q, qd)          # of the motors, before each step
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.simulation.drive_forces import adjoining
from walkerkit.gap.simulation.programs import Program
from walkerkit.gap.simulation.robot import Joint
from walkerkit.gap.simulation.start import rest
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]


class ProgramsAtWork:
    """Laws in Python in n_variants · n_segments simulations.

    Args:
        trials: the variants.
        n_segments: segments of each.
        columns: controls that a log has targets for.
        fields: model fields of the motors of which each simulation has its own.

    Attributes:
        programs: the laws.
        joints: their joints, in order.
        motors: controls of their motors.
        actuators: ids of their motors.
    """

    def __init__(
        self,
        trials: Trials,
        n_segments: int,
        columns: AbstractSet[int],
        fields: Mapping[str, NDArray[Any]],
    ):
        robot = trials.robot
        self.programs = robot.programs
        self.joints: tuple[Joint, ...] = tuple(
            robot.joints[name] for program in self.programs for name in program.joints
        )
        self.actuators = [joint.drives[0].actuator for joint in self.joints]
        self.motors = adjoining([int(robot.model.actuator_ctrladr[a]) for a in self.actuators])
        self._columns = frozenset(columns)
        self._every = max(1, round(robot.finer))
        self._numbers = {
            key: np.repeat(values, n_segments) for key, values in trials.numbers.items()
        }
        self._n_sims = trials.n * n_segments
        gain = np.stack([trials.encoder_gain[joint.name] for joint in self.joints], axis=1)
        self._gain = np.repeat(gain, n_segments, axis=0)
        self._motor = _motors(robot.model, self.actuators, fields, self._n_sims)

    @property
    def memory(self) -> bool:
        """Whether one of them remembers anything."""
        return any(program.memory for program in self.programs)

    def number(self, joint: str, name: str) -> FloatArray | None:
        """A number of a joint's law in every simulation, (n_sims,), or None where it has none."""
        varied = self._numbers.get((joint, name))
        if varied is not None:
            return varied
        for program in self.programs:
            if joint in program.joints and name in program.numbers:
                value = program.numbers[name][program.joints.index(joint)]
                return np.full(self._n_sims, float(value))
        return None

    def efforts(self, controls: FloatArray) -> FloatArray:
        """What the motors make of their controls, (n_sims, n_joints) [N·m; N]."""
        gain, bias, lowest, highest = self._motor
        made: FloatArray = np.clip(gain * controls + bias, lowest, highest)
        return made

    def joins(self, other: ProgramsAtWork) -> bool:
        """Whether these and others can be run as one."""
        return (
            len(self.programs) == len(other.programs)
            and all(
                one.cfg is its.cfg
                and one.inputs == its.inputs
                and one.numbers.keys() == its.numbers.keys()
                and all(np.array_equal(one.numbers[k], its.numbers[k]) for k in one.numbers)
                for one, its in zip(self.programs, other.programs, strict=True)
            )
            and self._every == other._every
            and self._columns == other._columns
        )

    @classmethod
    def joined(cls, parts: Sequence[ProgramsAtWork]) -> ProgramsAtWork:
        """Those of some simulations, and then of others, that can be run as one."""
        whole = copy(parts[0])
        whole._n_sims = sum(part._n_sims for part in parts)
        whole._gain = np.concatenate([part._gain for part in parts])
        whole._motor = np.concatenate([part._motor for part in parts], axis=1)
        keys = dict.fromkeys(key for part in parts for key in part._numbers)
        whole._numbers = {}
        for key in keys:
            each = [part.number(*key) for part in parts]
            whole._numbers[key] = np.concatenate([one for one in each if one is not None])
        return whole

    def some(self, rows: NDArray[np.intp]) -> ProgramsAtWork:
        """Those of some of the simulations."""
        part = copy(self)
        part._n_sims = len(rows)
        part._gain, part._motor = self._gain[rows], self._motor[:, rows]
        part._numbers = {key: values[rows] for key, values in self._numbers.items()}
        return part

    def start(self, model: mujoco.MjModel) -> RunningPrograms:
        """The laws at rest, ready to run.

        Args:
            model: the compiled model.
        """
        return RunningPrograms(self, model)


def _motors(
    model: mujoco.MjModel, ids: Sequence[int], fields: Mapping[str, NDArray[Any]], n_sims: int
) -> FloatArray:
    """Gain, bias, least and greatest effort of motors at their joints, (4, n_sims, n_motors)."""

    def own(name: str, at: Sequence[int]) -> NDArray[Any]:
        values = np.asarray(fields.get(name, getattr(model, name)[None]))[:, at]
        return np.broadcast_to(values, (n_sims, *values.shape[1:]))

    gear = own("actuator_gear", model.actuator_outadr[ids])[..., 0]
    limited = own("actuator_forcelimited", ids)[..., None] != 0
    ends = np.where(limited, own("actuator_forcerange", ids), [-np.inf, np.inf])
    bounds = np.sort(gear[..., None] * ends, axis=-1)
    affine = own("actuator_biastype", ids) == mujoco.mjtBias.mjBIAS_AFFINE
    bias = np.where(affine, own("actuator_biasprm", ids)[..., 0], 0.0)
    gain = own("actuator_gainprm", ids)[..., 0]
    return np.stack([gear * gain, gear * bias, bounds[..., 0], bounds[..., 1]])


class RunningPrograms:
    """Laws in Python that run.

    Attributes:
        of: what they are.
    """

    def __init__(self, of: ProgramsAtWork, model: mujoco.MjModel):
        self.of = of
        data = rest(model)
        n_sims = of._n_sims
        self._q = np.tile(data.qpos[[joint.qpos for joint in of.joints]], (n_sims, 1))
        self._qd = np.zeros_like(self._q)
        self._gain = None if (of._gain == 1).all() else of._gain
        self._parts: list[_Part] = []
        first = 0
        for program in of.programs:
            self._parts.append(_Part(program, of, n_sims, first))
            first += len(program.joints)
        self._made = np.zeros((n_sims, first))
        self._step = 0

    def at_rest_but(
        self, q: FloatArray, qd: FloatArray, places: dict[int, int]
    ) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities of their joints, of which some are given and others rest.

        Args:
            q: (n_sims, n) positions of some joints [rad; m].
            qd: (n_sims, n) their velocities [rad/s; m/s].
            places: place among their joints to that among those.
        """
        mine, theirs = [*places], [*places.values()]
        self._q[:, mine], self._qd[:, mine] = q[:, theirs], qd[:, theirs]
        return self._q, self._qd

    def controls(self, sent: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """The controls of their motors for the next step, (n_sims, n_joints).

        Args:
            sent: (n_sims, width) controls of MuJoCo and targets of the laws.
            q: (n_sims, n_joints) positions of their joints [rad; m].
            qd: (n_sims, n_joints) velocities [rad/s; m/s].
        """
        if self._gain is not None:
            q, qd = self._gain * q, self._gain * qd
        made = self._made.copy()
        for part in self._parts:
            if not part.memory or self._step % self.of._every == 0:
                made[:, part.span] = part.effort(sent, q[:, part.span], qd[:, part.span])
        self._step += 1
        self._made = made
        return made

    def forget(self, rows: NDArray[np.intp]) -> None:
        """Resets the laws of some simulations."""
        for part in self._parts:
            part.law.reset(rows)

    def begin(self) -> None:
        """The next step is one at which laws that remember run."""
        self._step = 0


class _Part:
    """One law among several."""

    def __init__(self, program: Program, of: ProgramsAtWork, n_sims: int, first: int):
        self.memory = program.memory
        self.span = slice(first, first + len(program.joints))
        self.law = program.law()
        shape = (n_sims, len(program.joints))
        self.law.allocate(shape)
        for name in self.law.names:
            varied = [k for k, joint in enumerate(program.joints) if (joint, name) in of._numbers]
            if varied:
                values = np.array(np.broadcast_to(self.law.get(name), shape))
                for k in varied:
                    values[:, k] = of._numbers[program.joints[k], name]
                self.law.set(name, values, None)
        self.law.reset(None)
        # A target that no log has is none at all, unless the law needs it.
        self._inputs = {
            kind: adjoining(columns)
            for kind, columns in program.inputs.items()
            if of._columns.intersection(columns) or f"{kind}_target" in self.law.needs
        }

    def effort(self, sent: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """What is left of the law's effort behind its limits."""
        targets = {kind: sent[:, columns] for kind, columns in self._inputs.items()}
        law = self.law.effort
        try:
            _, effort = law(
                targets.get("position"), targets.get("velocity"), targets.get("effort"), q, qd
            )
        except Exception as error:  # a law of a user's own may raise anything
            raise InputError(
                f"{law.__qualname__}, of the actuators, raised {type(error).__name__} in a replay: "
                f"{one_line(error)}. Mend it for whatever targets, positions and velocities."
            ) from error
        return effort
