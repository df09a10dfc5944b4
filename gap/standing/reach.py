"""Joint angles that put the base where it is wanted and leave the feet where they are.

    reach = Reach(stand)
    qpos = reach.poses(shift, turn, lifted)        # (T, nq)
    reach.worst                                    # m, by which a foot is missed at most

Damped least squares on the Jacobians of the points that touch the ground, from one pose to the next
(Buss, Introduction to inverse kinematics, 2009); closed loops are further rows. A sole that more
than one point of touches the ground keeps its attitude where its leg has the six joints that this
takes; of a leg with fewer the middle of the sole stays.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.simulation.robot import Joint
from walkerkit.gap.standing.soles import Sole
from walkerkit.gap.standing.standing_pose import Stand

FloatArray = NDArray[np.float64]

_ITERATIONS = 12
_CLOSE = 1e-5  # m
_DAMPED = 1e-4  # m, against joints that hardly move a foot
_LARGEST = 0.2  # rad (m) in one iteration
_UPWARDS = np.array([0.0, 0.0, 1.0])
_WHOLE = 6  # joints that a foot takes to be put anywhere in any attitude


class Reach:
    """Inverse kinematics of a robot on its feet.

    Args:
        stand: the robot as it stands.

    Attributes:
        worst: how far a foot is from where it should be, at most, in the poses asked for last [m].
    """

    def __init__(self, stand: Stand):
        self._stand = stand
        model = stand.robot.model
        self._model, self._data = model, stand.at(stand.qpos)
        loops = stand.robot.loops
        self._loops = loops if loops.any else None
        led = [j for n, j in stand.robot.joints.items() if n in loops.joints]
        moved = {joint.name: joint for joint in (*stand.joints, *led)}
        self._joints: tuple[Joint, ...] = tuple(moved.values())
        self._soles = tuple(self._kept(sole) for sole in stand.soles)
        self._at = [sole.where(self._data) for sole in self._soles]
        ids = [joint.id for joint in self._joints]
        limited = model.jnt_limited[ids] != 0
        self._lower = np.where(limited, model.jnt_range[ids, 0], -np.inf)
        self._upper = np.where(limited, model.jnt_range[ids, 1], np.inf)
        self.worst = 0.0

    def poses(self, shift: FloatArray, turn: FloatArray, lifted: FloatArray) -> FloatArray:
        """The poses along a path of the base.

        Args:
            shift: (T, 3) of the base from where it stands, in the world's frame [m].
            turn: (T, 3) of it, a rotation vector about the world's axes [rad].
            lifted: (T, n_soles) how high the soles are above where they stand [m].

        Returns:
            (T, nq) poses.
        """
        base, home = self._stand.base, self._stand.qpos
        place = slice(base.qpos, base.qpos + 3)
        turned = slice(base.qpos + 3, base.qpos + 7)
        w, *vector = home[turned]
        upright = Rotation.from_quat([*vector, w])
        quaternions = np.roll((Rotation.from_rotvec(turn) * upright).as_quat(), 1, axis=1)
        qpos, found = home.copy(), np.empty((len(shift), len(home)))
        self.worst = 0.0
        for t in range(len(shift)):
            qpos[place] = home[place] + shift[t]
            qpos[turned] = quaternions[t]
            self.worst = max(self.worst, self._solve(qpos, lifted[t]))
            found[t] = qpos
        return found

    def _kept(self, sole: Sole) -> Sole:
        """What of a sole is kept where it stands."""
        model, above, body = self._model, set[int](), sole.body
        while body:
            above.add(body)
            body = int(model.body_parentid[body])
        leg = [j for j in self._joints if int(model.jnt_bodyid[j.id]) in above]
        if len(leg) >= _WHOLE or len(sole.points) == 1:
            return sole
        middle = sole.points.mean(axis=0, keepdims=True)
        return Sole(name=sole.name, body=sole.body, points=middle)

    def _solve(self, qpos: FloatArray, lifted: FloatArray) -> float:
        """Moves the joints, in place, until the soles are where they should be; how far not [m]."""
        dofs = [joint.dof for joint in self._joints]
        at = [joint.qpos for joint in self._joints]
        for left in range(_ITERATIONS, -1, -1):
            wrong, jacobian, missed = self._wrong(qpos, lifted)
            if missed < _CLOSE or not left:
                return missed
            own = jacobian[:, dofs]
            square = own.T @ own
            square[np.diag_indices(len(dofs))] += _DAMPED**2
            step = np.linalg.solve(square, own.T @ wrong)
            step *= min(1.0, _LARGEST / max(np.abs(step).max(), 1e-12))
            qpos[at] = np.clip(qpos[at] + step, self._lower, self._upper)
        return missed

    def _wrong(self, qpos: FloatArray, lifted: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """(rows,) what is to be made up, (rows, nv) its Jacobian, and how far a sole is off [m]."""
        model, data = self._model, self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        wrong, rows = [], []
        for sole, at, up in zip(self._soles, self._at, lifted, strict=True):
            points = sole.where(data)
            for point, wanted in zip(points, at, strict=True):
                jacobian = np.zeros((3, model.nv))
                mujoco.mj_jac(model, data, jacobian, None, point, sole.body)
                wrong.append(wanted + up * _UPWARDS - point)
                rows.append(jacobian)
        missed = max(float(np.linalg.norm(one)) for one in wrong)
        if self._loops is not None:
            open_, jacobian = self._loops.residual(qpos)
            wrong.append(-open_)
            rows.append(jacobian)
            missed = max(missed, float(np.abs(open_).max(initial=0.0)))
        return np.concatenate(wrong), np.concatenate(rows), missed
