"""Changes of actuators, in the words of the element that they have in the file.

A `<position>` says its gains as `kp` and `kv`, a `<velocity>` as `kv`; what these cannot say, such
as a constant effort, makes a `<general>` of it with the same meaning.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from walkerkit.gap.deliver.markup import Document, Node
from walkerkit.gap.deliver.numerals import numerals, whole

_OF_SHORTCUTS = ("kp", "kv", "dampratio", "timeconst", "inheritrange")
_INTERPOLATIONS = ("zoh", "linear", "cubic")
_BIASES = {0: "none", 1: "affine"}
_DYNAMICS = {0: "none", 2: "filter", 3: "filterexact"}
_GAINS, _BIAS = 3, 3  # of gainprm and biasprm, those that an affine actuator has


def patch_drives(
    document: Document,
    find: Callable[[int], Node],
    before: mujoco.MjModel,
    after: mujoco.MjModel,
) -> None:
    """Writes into a document what changed of actuators.

    Args:
        document: the file; changed.
        find: an actuator's id to its element.
        before: the model as the file has it.
        after: the model as it is to be.

    Raises:
        ValueError: an element cannot say it.
    """
    for number in range(before.nactuator):
        _patch_law(document, find, before, after, number)
        if before.actuator_forcelimited[number] != after.actuator_forcelimited[number]:
            limited = "true" if after.actuator_forcelimited[number] else "false"
            document.set(find(number), "forcelimited", limited)
        wanted = after.actuator_forcerange[number]
        if not np.array_equal(before.actuator_forcerange[number], wanted):
            document.set(find(number), "forcerange", numerals(wanted))
        _patch_delay(document, find, before, after, number)


def _patch_delay(
    document: Document,
    find: Callable[[int], Node],
    before: mujoco.MjModel,
    after: mujoco.MjModel,
    number: int,
) -> None:
    if before.actuator_delay[number] != after.actuator_delay[number]:
        document.set(find(number), "delay", whole([after.actuator_delay[number]]))
    # Number of samples, then how it is between them.
    old, new = before.actuator_history[number], after.actuator_history[number]
    if old[0] != new[0]:
        document.set(find(number), "nsample", str(int(new[0])))
    if old[1] != new[1]:
        document.set(find(number), "interp", _INTERPOLATIONS[int(new[1])])


def _patch_law(
    document: Document,
    find: Callable[[int], Node],
    before: mujoco.MjModel,
    after: mujoco.MjModel,
    number: int,
) -> None:
    """What an actuator makes of its control and of the joint's state."""
    if all(
        np.array_equal(getattr(before, name)[number], getattr(after, name)[number])
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_biastype")
    ):
        return
    node = find(number)
    old_gain, gain = (float(m.actuator_gainprm[number, 0]) for m in (before, after))
    old_bias, bias = (m.actuator_biasprm[number, :_BIAS] for m in (before, after))
    ratio = node.get("dampratio") is not None
    if node.tag == "position" and not ratio and bias[0] == 0 and np.isclose(gain, -bias[1]):
        if gain != old_gain:
            document.set(node, "kp", numerals([gain]))
        if bias[2] != old_bias[2]:
            document.set(node, "kv", numerals([-bias[2]]))
    elif node.tag == "velocity" and not bias[:2].any() and np.isclose(gain, -bias[2]):
        document.set(node, "kv", numerals([gain]))
    elif node.tag == "general":
        _set_law(document, node, after, number)
    elif node.tag in ("position", "velocity", "motor"):
        _make_general(document, node, after, number)
    else:
        raise ValueError(f"actuator {after.actuator(number).name!r} is a <{node.tag}>")


def _set_law(document: Document, node: Node, model: mujoco.MjModel, number: int) -> None:
    gains = model.actuator_gainprm[number, :_GAINS]
    document.set(node, "gainprm", numerals(gains))
    kind = int(model.actuator_biastype[number])
    if kind not in _BIASES:
        raise ValueError(f"actuator {model.actuator(number).name!r} has a bias of its own kind")
    document.set(node, "biastype", _BIASES[kind])
    document.set(node, "biasprm", numerals(model.actuator_biasprm[number, :_BIAS]))


def _make_general(document: Document, node: Node, model: mujoco.MjModel, number: int) -> None:
    """Says all of an actuator's law without the words of its shortcut."""
    document.rename(node, "general")
    document.drop(node, *_OF_SHORTCUTS)
    _set_law(document, node, model, number)
    dynamics = int(model.actuator_dyntype[number])
    if dynamics:
        document.set(node, "dyntype", _DYNAMICS[dynamics])
        document.set(node, "dynprm", numerals(model.actuator_dynprm[number, :1]))
    if node.get("inheritrange") is not None and model.actuator_ctrllimited[number]:
        document.set(node, "ctrlrange", whole(model.actuator_ctrlrange[number]))
