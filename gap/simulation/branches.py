"""Branches: parts of a robot that cannot feel each other, such as the legs of one that is hung up.

    of_joint, of_body = branches(robot)      # {"FL_knee": 0, "FR_knee": 1, ...}, {"FL_calf": 0}

What is changed in one branch shows in that branch only, so that one simulation can try something
in all of them at once (the compressed differences of Curtis, Powell and Reid, J. Inst. Maths
Applics 13, 1974).
"""

from __future__ import annotations

import copy
import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import mujoco
import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.robot import Robot

_POSES = 200  # of each recording, at which it is seen what is near
_NEAR = 0.01  # m, from which on what is tried might touch
_OF_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def branches(robot: Robot) -> tuple[Mapping[str, int], Mapping[str, int]]:
    """Joint to branch, and body to branch; a branch is a number.

    Kinematic trees that a contact, an equality, a tendon or a site's transmission could couple are
    one branch. Where recordings say which trees came near each other, no others have contacts.
    """
    model = robot.model
    branch = _joined(model, robot.met)
    joints = {name: branch[model.dof_treeid[joint.dof]] for name, joint in robot.joints.items()}
    of_body = {name: int(model.body_treeid[model.body(name).id]) for name in robot.bodies}
    return joints, {name: branch[tree] for name, tree in of_body.items() if tree >= 0}


def largest(robot: Robot) -> int:
    """Degrees of freedom of the largest branch, which a change in one place may all move."""
    model = robot.model
    branch = _joined(model, robot.met)
    return max(Counter(branch[tree] for tree in model.dof_treeid).values(), default=0)


def met(robot: Robot, recordings: Sequence[Recording]) -> frozenset[tuple[int, int]] | None:
    """Pairs of kinematic trees that came within `_NEAR` of each other in some recordings.

    Returns:
        The pairs, lower tree first; None where the recordings do not say, as of a base that floats.
    """
    model = robot.model
    missing = [name for r in recordings for name in robot.joints if name not in r.joints]
    if robot.base is not None or not recordings or missing or model.ntree < 2:
        return None
    wide = copy.copy(model)
    wide.geom_margin[:] = np.maximum(wide.geom_margin, _NEAR)
    data, pairs = mujoco.MjData(wide), set[tuple[int, int]]()
    for recording in recordings:
        rows = np.unique(np.linspace(0, len(recording.time) - 1, _POSES).astype(int))
        for row in rows:
            for name, joint in robot.joints.items():
                data.qpos[joint.qpos] = recording.columns[f"{name}/position"][row]
            mujoco.mj_fwdPosition(wide, data)
            trees = wide.body_treeid[wide.geom_bodyid[data.contact.geom]].reshape(-1, 2)
            pairs |= {(int(a), int(b)) for a, b in np.sort(trees, axis=1) if 0 <= a < b}
    return frozenset(pairs)


def _joined(model: mujoco.MjModel, together: frozenset[tuple[int, int]] | None = None) -> list[int]:
    """Each tree's branch, numbered by its first tree."""
    alone = list(range(model.ntree))
    coupled = model.neq or model.ntendon or model.nplugin
    if coupled or any(int(kind) not in _OF_JOINTS for kind in model.actuator_trntype):
        return [0] * model.ntree
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return alone
    if together is not None:
        return _linked(alone, together)
    if model.npair:
        return [0] * model.ntree
    kinds: dict[int, set[tuple[int, int]]] = {}
    for geom in range(model.ngeom):
        tree = int(model.body_treeid[model.geom_bodyid[geom]])
        kind = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        if tree >= 0 and any(kind):
            kinds.setdefault(tree, set()).add(kind)
    return _linked(
        alone,
        (
            (one, other)
            for (one, mine), (other, theirs) in itertools.combinations(kinds.items(), 2)
            if any(a & d or c & b for a, b in mine for c, d in theirs)
        ),
    )


def _linked(branch: list[int], pairs: Iterable[tuple[int, int]]) -> list[int]:
    """The branch of each tree, once those of each pair are one."""
    for one, other in pairs:
        first, last = sorted((branch[one], branch[other]))
        branch = [first if own == last else own for own in branch]
    return branch


def descends(model: mujoco.MjModel, body: int, carrier: int) -> bool:
    """Whether a body is another, or is carried by it."""
    while body and body != carrier:
        body = int(model.body_parentid[body])
    return body == carrier
