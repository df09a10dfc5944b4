"""Robots from files, walkers and specs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.recordings.given import is_callable, model_name
from walkerkit.gap.simulation.base import find_base
from walkerkit.gap.simulation.ground_geoms import Ground, add_floor
from walkerkit.gap.simulation.made import spec_of
from walkerkit.gap.simulation.model_files import check_model_files
from walkerkit.gap.simulation.programs import with_programs
from walkerkit.gap.simulation.robot import Robot, scalar_joints
from walkerkit.gap.simulation.users_code import blamed_on, function_named

_MEND = "Mend the MJCF until MuJoCo loads it."
_REMEDY = "Mend it until it returns the walker without arguments."


def load_robot(source: str | Path, *, floating: bool = False, allow_outside: bool = False) -> Robot:
    """Loads and compiles a model.

    Args:
        source: path of an MJCF (or URDF) file, or `package.module:callable`, a function without
            arguments that returns a walker, a PyMJCF element, an MjSpec or MJCF text.
        floating: a walker that has a free joint in an arena has it here too; what is no walker
            floats or does not as its model says.
        allow_outside: a file's meshes, textures and included files may lie outside of its folder.

    Returns:
        The robot, on a level floor where it floats and its model has nothing to stand on.

    Raises:
        InputError: the file is missing, reaches out of its folder or does not compile, or the robot
            has no joint to compare.
    """
    name = model_name(source)
    if is_callable(name):
        made = _made_by(name)
        robot = robot_from_spec(_spec_of(made, name, floating), name)
        drivetrain = getattr(made, "drivetrain", None)
        if drivetrain is None:
            return robot
        with blamed_on(name, _REMEDY):
            return with_programs(robot, drivetrain)
    return robot_from_spec(_spec_from_file(Path(name), allow_outside), name)


def robot_from_spec(spec: mujoco.MjSpec, source: str) -> Robot:
    """Compiles `spec`; `source` names it in messages.

    Raises:
        InputError: it does not compile, several robots float in it, or it has no named hinge or
            slide joint.
    """
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"{source}: the model does not compile: {one_line(error)}. {_MEND}"
        ) from None
    base = find_base(model, source)
    notes: tuple[str, ...] = ()
    if base is not None and not Ground(model):
        spec = spec.copy()
        notes = (add_floor(spec),)
        model = spec.compile()
    joints = scalar_joints(model)
    if not joints:
        raise InputError(f"{source}: the model has no named hinge or slide joint. Name its joints.")
    return Robot(source=source, spec=spec, model=model, joints=joints, base=base, notes=notes)


def _spec_from_file(path: Path, allow_outside: bool) -> mujoco.MjSpec:
    if not path.is_file():
        raise InputError(
            f"{path}: no such model file. Give an MJCF file or `package.module:callable`."
        )
    check_model_files(path, allow_outside=allow_outside)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError) as error:
        raise InputError(
            f"{path}: the model does not compile: {one_line(error)}. {_MEND}"
        ) from None


def _made_by(source: str) -> Any:
    """What a user's function returns."""
    make = function_named(source, "the walker")
    with blamed_on(source, _REMEDY):
        return make()


def _spec_of(made: Any, source: str, floating: bool) -> mujoco.MjSpec:
    with blamed_on(source, _REMEDY):
        return spec_of(made, source, floating=floating)
