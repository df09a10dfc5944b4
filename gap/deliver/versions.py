"""Which version of MuJoCo reads what a mended model says."""

from __future__ import annotations

from collections.abc import Iterable

from walkerkit.gap.deliver.markup import Edit

# The first version whose schema has the attribute, or takes more than one number in it. Which it
# is was tried with every release that there is between 3.3 and 3.8: `benchmarks/mujoco_versions`.
_SINCE = {
    ("actuator", "delay"): (3, 5),
    ("actuator", "nsample"): (3, 5),
    ("actuator", "interp"): (3, 5),
    ("joint", "damping"): (3, 7),
    ("joint", "stiffness"): (3, 7),
}
_POLYNOMIAL = ("damping", "stiffness")


def needed(edits: Iterable[Edit]) -> dict[str, str]:
    """What of some changes an older MuJoCo does not read.

    Args:
        edits: changes of a model that MuJoCo reads.

    Returns:
        Element and attribute to the first version of MuJoCo that reads it; empty where the changed
        model takes no other version than the model did.
    """
    found = {}
    for edit in edits:
        kind = "joint" if edit.node.tag == "joint" else "actuator"
        since = _SINCE.get((kind, edit.attribute))
        if since is None or (edit.attribute in _POLYNOMIAL and len(edit.now.split()) < 2):
            continue
        found[f"{kind}/{edit.attribute}"] = ".".join(map(str, since))
    return dict(sorted(found.items()))
