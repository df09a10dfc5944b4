"""Branches: parts of a robot that cannot feel each other, such as the legs of one that is hung up.

    of_joint, of_body = branches(robot)      # {"FL_knee": 0, "FR_knee": 1, ...}, {"FL_calf": 0}

What is changed in one branch shows in that branch only, so that one simulation can try something
in all of them at once (the compressed differences of Curtis, Powell and Reid, J. Inst. Maths
Applics 13, 1974).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import mujoco

from walkerkit.gap.simulation.robot import Robot

_OF_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def branches(robot: Robot) -> tuple[Mapping[str, int], Mapping[str, int]]:
    """Joint to branch, and body to branch; a branch is a number.

    Kinematic trees that a contact, an equality, a tendon or a site's transmission could couple are
    one branch.
    """
    model = robot.model
    branch = _joined(model)
    joints = {name: branch[model.dof_treeid[joint.dof]] for name, joint in robot.joints.items()}
    of_body = {name: int(model.body_treeid[model.body(name).id]) for name in robot.bodies}
    return joints, {name: branch[tree] for name, tree in of_body.items() if tree >= 0}


def _joined(model: mujoco.MjModel) -> list[int]:
    """Each tree's branch, numbered by its first tree."""
    alone = list(range(model.ntree))
    coupled = model.neq or model.ntendon or model.nplugin
    if coupled or any(int(kind) not in _OF_JOINTS for kind in model.actuator_trntype):
        return [0] * model.ntree
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return alone
    if model.npair:
        return [0] * model.ntree
    kinds: dict[int, set[tuple[int, int]]] = {}
    for geom in range(model.ngeom):
        tree = int(model.body_treeid[model.geom_bodyid[geom]])
        kind = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        if tree >= 0 and any(kind):
            kinds.setdefault(tree, set()).add(kind)
    for (one, mine), (other, theirs) in itertools.combinations(kinds.items(), 2):
        if any(a & d or c & b for a, b in mine for c, d in theirs):
            first, last = sorted((alone[one], alone[other]))
            alone = [first if branch == last else branch for branch in alone]
    return alone
