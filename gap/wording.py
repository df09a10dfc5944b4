"""What a diagnosis says, in sentences that the console and the report share.

Names come from the user's files: characters that would not print are replaced, and whoever embeds
the text in a format of its own (HTML, plotly, rich) escapes it there.
"""

from __future__ import annotations

from collections.abc import Sequence

from walkerkit.gap.diagnosis import Diagnosis, Estimate, Gap, GapSize, Location, NamedEffect
from walkerkit.gap.quantity import estimate_text, percent, quantity, span

EVERYWHERE = "*"
AT_BOUND = "at the bound of its range, not an estimate"
NOT_IDENTIFIABLE = "no standard error: these recordings do not determine it"
TITLES = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "no_gap": "No gap",
    "unexplained": "Unexplained",
}

_PROPER = {"coulomb": "Coulomb", "stribeck": "Stribeck"}
_FEW = 4  # sites that a sentence lists
_SHRUNK = 0.95  # a gap above this part of what it was has not visibly shrunk
_PARTS_CLEARLY = 3.0  # standard deviations


def label(name: str) -> str:
    """A name from the user's files without characters that do not print."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in name)


def words(name: str) -> str:
    """A name of ours in words: `coulomb_friction` is Coulomb friction."""
    parts = label(name).split("_")
    return " ".join(_PROPER.get(part, part) for part in parts)


def headed(text: str) -> str:
    """The text with a capital letter in front."""
    return text[:1].upper() + text[1:]


def listed(items: Sequence[str], last: str = "and") -> str:
    """`a, b and c`."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"


def site(name: str) -> str:
    """A joint or body, or what `*` stands for."""
    return "whole robot" if name == EVERYWHERE else label(name)


def place(named: NamedEffect) -> str:
    """Where an effect is: ` at calf`, ` of body shin`, ` of the whole robot`; may be empty."""
    sites = named.joints or named.bodies
    if not sites:
        return ""
    if sites == (EVERYWHERE,):
        return " of the whole robot"
    shown = [label(name) for name in sites]
    if len(shown) > _FEW:
        shown = [*shown[: _FEW - 1], f"{len(shown) - _FEW + 1} more"]
    kind = " at " if named.joints else " of body " if len(sites) == 1 else " of bodies "
    return kind + listed(shown)


def step(named: NamedEffect) -> str:
    """An effect and its place: `Coulomb friction at calf`."""
    return words(named.effect) + place(named)


def spot(at: Location) -> str:
    """A joint and a regime: `calf (velocity reversal)`."""
    return f"{site(at.joint)} ({words(at.regime)})"


def estimate(of: Estimate) -> tuple[str, str, str]:
    """An estimate as it is printed.

    Returns:
        The number, with ± only where it is an estimate; its unit; and a warning, or "".
    """
    text, unit = estimate_text(of.value, None if of.at_bound else of.std, of.unit)
    if of.at_bound:
        return text, unit, AT_BOUND
    return text, unit, "" if "±" in text else NOT_IDENTIFIABLE


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """What was found, where, how sure, and how much the gap shrank."""
    signal, size = _telling(diagnosis.gap)
    error = f"the {words(signal)} error"
    numbers = (size.before, size.after, size.noise_floor)
    if diagnosis.verdict == "no_gap":
        before, floor = span((size.before, size.noise_floor), size.unit)
        return (
            f"Nothing is missing from the model: {error} is {before}, and the noise of the "
            f"measurement alone would leave {floor}."
        )
    found = _found(diagnosis.effects)
    where = _largest(diagnosis.locations)
    if diagnosis.verdict == "unexplained" or not found:
        before, floor = span((size.before, size.noise_floor), size.unit)
        return (
            f"No effect of the catalogue explains the gap: {error} is {before}, where the noise of "
            f"the measurement alone would leave {floor}"
            f"{f', and is largest at {where}' if where else ''}."
        )
    before, after, floor = span(numbers, size.unit)
    part = "" if diagnosis.verdict == "explained" else "part of "
    verb = "explains" if len(diagnosis.effects) == 1 else "explain"
    left = _largest(diagnosis.remaining) if part else ""
    return (
        f"{found} {verb} {part}the gap: {error} shrinks from {before} to {after}, where the noise "
        f"of the measurement alone would leave {floor}"
        f"{f'; what remains is largest at {left}' if left else ''}."
    )


def basis(gap: Gap) -> str:
    """On what the gap was measured."""
    data = (
        "on held-out recordings, which no fit has seen"
        if gap.held_out
        else "on the recordings that were fitted, so that it flatters the model"
    )
    replay = (
        "over whole rollouts"
        if gap.horizon is None
        else f"over windows of {quantity(gap.horizon, 's')} that restart from the measured state"
    )
    return f"Root-mean-square error, {data}, {replay}."


def doubts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """One sentence for each confusion set."""
    return tuple(
        f"{headed(step(named))} cannot be told from "
        f"{listed([words(other) for other in named.indistinguishable_from], 'or')}: with these "
        "recordings each of them fits equally well within the noise. The mended model moves like "
        "the robot either way, but the cause, and the numbers given for it, may be another's."
        for named in diagnosis.effects
        if named.indistinguishable_from
    )


def advice(diagnosis: Diagnosis) -> str:
    """What to record next, or "" where nothing needs it."""
    wanted = diagnosis.next_experiment
    if wanted is None:
        return ""
    sure = "" if wanted.separation >= _PARTS_CLEARLY else ", which may not be enough"
    between = listed([words(name) for name in wanted.between])
    file = (
        f" Play {label(wanted.file)}, record it, and diagnose again with both."
        if wanted.file
        else " Record it, and diagnose again with both."
    )
    return (
        f"The excitation “{words(wanted.excitation)}” would tell {between} apart best: their "
        f"predictions differ by {wanted.separation:.1f} standard deviations of the noise{sure}."
        f"{file}"
    )


def _telling(gap: Gap) -> tuple[str, GapSize]:
    """The position gap, or the signal that shrank most where position hides the change."""
    sizes = {"position": gap.position}
    if gap.position.after > _SHRUNK * gap.position.before:
        sizes |= {
            name: size
            for name, size in gap.signals.items()
            if size.before > 0 and size.after <= _SHRUNK * size.before
        }
    shrunk = {n: s.after / s.before if s.before > 0 else 1.0 for n, s in sizes.items()}
    best = min(shrunk, key=lambda name: shrunk[name])
    return best, sizes[best]


def _found(effects: Sequence[NamedEffect]) -> str:
    found = []
    for named in effects:
        others = [words(name) for name in named.indistinguishable_from]
        doubt = f", could also be {listed(others, 'or')}" if others else ""
        found.append(f"{step(named)} ({percent(named.confidence)} sure{doubt})")
    return headed(listed(found))


def _largest(locations: Sequence[Location]) -> str:
    return spot(max(locations, key=lambda at: at.share)) if locations else ""
