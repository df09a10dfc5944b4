"""The fit that every practitioner tries first: what all models have a little wrong, by `gap.fit`.

    gap.fit(problem, plain(problem))

Armature, damping, dry friction and the servo's gains of each joint, and one delay of the commands.
Two of them need a second look. Where no effort is logged, damping and velocity gain are one number
and only the damping is fitted. Where one servo has several gains, known and in a model each, their
common factor may be wrong, which is the `torque_constant`.
"""

from __future__ import annotations

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.search.problem import Problem

PLAIN = (
    "armature",
    "viscous_friction",
    "coulomb_friction",
    "position_gain",
    "velocity_gain",
    "command_delay",
)
"""Names of the effects."""
MORE = {"xl330": ("directional_efficiency",)}
"""What a log is known to show beside these: the gearbox of the XL330 rubs with its load."""


def plain(problem: Problem, *more: str) -> dict[str, str | tuple[str, ...]]:
    """The plain structure of a problem.

    Args:
        problem: what `gap.load` returned.
        more: effects beside the plain ones.

    Returns:
        What `gap.fit` takes: effect to its joints, or to `*` where all share one value.
    """
    signals = {channel.signal for channel in problem.channels}
    names = [*PLAIN, *more]
    if len(problem.robots) > 1:
        names[names.index("position_gain")] = "torque_constant"
    found: dict[str, str | tuple[str, ...]] = {}
    for name in names:
        effect = CATALOGUE[name]
        sites = [effect.sites(robot, problem.joints) for robot in problem.robots]
        everywhere = tuple(site for site in sites[0] if all(site in other for other in sites))
        alike = equivalences(name, signals, robot=problem.robots[0], joints=everywhere)
        if not everywhere or (name == "velocity_gain" and "viscous_friction" in alike):
            continue
        found[name] = EVERYWHERE if effect.shared else everywhere
    return found
