"""From what a user's function returns to an MjSpec."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from walkerkit.gap.errors import InputError


def spec_of(made: Any, source: str, *, floating: bool = False) -> mujoco.MjSpec:
    """The spec of a walker, with its home as a keyframe, a PyMJCF element, an MjSpec or MJCF text.

    Args:
        made: one of these.
        source: names it in messages.
        floating: give a walker the free joint that it has in an arena; its joints and bodies are
            called as in its own model.

    Raises:
        InputError: it is none of these.
    """
    if isinstance(made, mujoco.MjSpec):
        return made
    if isinstance(made, str):
        return mujoco.MjSpec.from_string(made)
    root = getattr(made, "mjcf_model", made)
    if not hasattr(root, "to_xml_string"):
        raise InputError(
            f"{source}: returned a {type(made).__name__}. "
            "Return a walker, a PyMJCF element, an MjSpec or MJCF text."
        )
    prefix = ""
    if floating and hasattr(made, "create_root_joints") and root.parent_model is None:
        from dm_control import composer

        arena = composer.Arena()
        made.create_root_joints(arena.attach(made))
        root, prefix = arena.mjcf_model, f"{root.model}/"
    text = _plain_names(root.to_xml_string(), prefix)
    spec = mujoco.MjSpec.from_string(text, assets=root.get_assets())
    _add_home(spec, made, floats=bool(prefix))
    return spec


def _add_home(spec: mujoco.MjSpec, walker: Any, *, floats: bool) -> None:
    """Makes a walker's home pose the first keyframe, which neither it nor an arena keeps."""
    joints, place, turn = getattr(walker, "upright_pose", (None, None, None))
    parts = [place, turn, joints] if floats else [joints]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts) or spec.keys:
        return
    qpos = np.concatenate(known)
    if len(qpos) == spec.copy().compile().nq:
        spec.add_key(name="home", qpos=qpos)


def _plain_names(text: str, prefix: str) -> str:
    """PyMJCF's text without a prefix, and without names that it makes up and refuses to read."""
    root = ElementTree.fromstring(text)
    walker = prefix.rstrip("/")
    for element in root.iter():
        for key, value in element.attrib.items():
            if value == "/":
                element.set(key, "pymjcf")
            elif value.startswith("//unnamed_"):
                element.set(key, value.removeprefix("//"))
            elif prefix and value == prefix:
                # The frame that it hangs on, or the class of its defaults.
                element.set(key, walker if key == "name" else f"pymjcf_{walker}")
            elif prefix and value.startswith(prefix):
                own = value.removeprefix(prefix)
                element.set(key, own.replace("/unnamed_", f"{walker}_unnamed_"))
    return ElementTree.tostring(root, encoding="unicode")
