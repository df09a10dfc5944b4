"""What a diagnosis says, in sentences that the console and the report share.

Names come from the user's files: characters that would not print are replaced, and whoever embeds
the text in a format of its own (HTML, plotly, rich) escapes it there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from walkerkit.gap.report.diagnosis import Diagnosis, Estimate, Hint, NamedEffect, NextExperiment
from walkerkit.gap.report.gaps import Gap, GapSize, Location
from walkerkit.gap.report.quantity import estimate_text, percent, quantity, span
from walkerkit.gap.report.regimes import EVERYWHERE as EVERY_REGIME
from walkerkit.gap.report.set_ups import RELEASE

EVERYWHERE = "*"
AT_BOUND = "at its bound"
NOT_IDENTIFIABLE = "not determined"
WARNINGS = {
    AT_BOUND: "A value at its bound ran into the limit of its range: it is no estimate, without ±.",
    NOT_IDENTIFIABLE: "A value that is not determined has no ±: others fit as well.",
}
VALUES = (
    "Values are added to what the model has, except limits, rest angles, timesteps and the numbers "
    "of laws in actuators.json, which are what they say."
)
SURE = (
    "“Sure” is the weight of all structures that have the effect, or another that these channels "
    "cannot tell from it, among all that were compared."
)
TITLES = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "no_gap": "No gap",
    "unexplained": "Unexplained",
}

_FEW = 4  # sites that a sentence lists
_SHRUNK = 0.95  # a gap above this part of what it was has not visibly shrunk
_PARTS_CLEARLY, _FAR = 3.0, 100  # standard deviations
_MOST_SURE = 0.999
_NORMAL_95, _INTERVAL_DIGITS = 1.96, 3


def label(name: str) -> str:
    """A name from the user's files without characters that do not print."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in name)


def tight(text: str) -> str:
    """The text with numbers that no line break parts from their units."""
    return re.sub(r"(?<=\d) (?=%|[^\W\d])", "\N{NO-BREAK SPACE}", text)


def words(name: str) -> str:
    """A signal or regime in words: `velocity_reversal` is velocity reversal.

    Effects and excitations keep the names under which the user finds them again.
    """
    return label(name).replace("_", " ")


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
    shown = _some(sites)
    kind = " at " if named.joints else " of body " if len(sites) == 1 else " of bodies "
    return kind + listed(shown)


def _some(names: Sequence[str]) -> list[str]:
    """The names, or few of them and how many more there are."""
    shown = [label(name) for name in names]
    if len(shown) > _FEW:
        shown = [*shown[: _FEW - 1], f"{len(shown) - _FEW + 1} more"]
    return shown


def step(named: NamedEffect) -> str:
    """An effect and its place: `coulomb_friction at calf`."""
    return label(named.effect) + place(named)


def spot(at: Location) -> str:
    """A joint and a regime: `calf (velocity reversal)`, or `calf` where no regime stands out."""
    regime = "" if at.regime == EVERY_REGIME else f" ({words(at.regime)})"
    return f"{site(at.joint)}{regime}"


def estimate(of: Estimate) -> tuple[str, str, str]:
    """An estimate as it is printed.

    Returns:
        The number, with ± only where it is fitted; its unit; and a warning, or "".
    """
    text, unit = estimate_text(of.value, None if of.at_bound else of.std, of.unit)
    if of.at_bound:
        return text, unit, AT_BOUND
    chosen = of.std == 0  # among a few values, not fitted
    return text, unit, "" if chosen or "±" in text else NOT_IDENTIFIABLE


def interval(of: Estimate) -> str:
    """The 95 % interval of an estimate, or "" where it is none."""
    if of.at_bound or not of.std:
        return ""
    half = _NORMAL_95 * of.std
    ends = of.value - half, of.value + half
    largest = max(map(abs, ends))
    digits = max(_INTERVAL_DIGITS, 1 + math.ceil(math.log10(largest / half))) if half else 1
    return " to ".join(span(ends, of.unit, digits))


def warnings(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What the warnings in the table of the estimates mean; empty where there are none."""
    shown = {estimate(of)[2] for named in diagnosis.effects for of in named.parameters}
    return tuple(meaning for warning, meaning in WARNINGS.items() if warning in shown)


def title(diagnosis: Diagnosis) -> str:
    """The verdict in a word or two."""
    if not diagnosis.searched and diagnosis.verdict != "no_gap":
        return "Gap"
    return TITLES[diagnosis.verdict]


def wiring(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What is wrong with the wiring, a paragraph each, to be read before all else."""
    everything = set(diagnosis.recordings)
    return tuple(
        label(error.sentence(everything <= {*error.recordings})) for error in diagnosis.wiring
    )


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """What was found, where, how sure, and how much the gap shrank."""
    signal, size = telling(diagnosis.gap)
    error = f"the {words(signal)} error"
    noise = _floors(diagnosis.gap, signal, size)
    before, after = span((size.before, size.after), size.unit)
    moved = f"shrinks from {before} to {after}"
    if size.after >= size.before:
        moved = f"does not shrink, but is {before} before and {after} after"
    told = f"is {quantity(size.before, size.unit)}"
    if math.isnan(size.before):
        told = "is unknown, as the simulation diverges"
        moved = f"is {after}, and unknown before, as the simulation diverges"
    if diagnosis.verdict == "no_gap":
        coarse = diagnosis.gap.finer_position is not None
        return (
            f"Nothing is missing from the model{' but a finer timestep' if coarse else ''}: "
            f"{error} {told}, and {noise}."
        )
    if not diagnosis.effects:
        where = spot(diagnosis.locations[0]) if diagnosis.locations else ""
        subject = _nothing_explains(diagnosis)
        return (
            f"{subject}: {error} {told}, where {noise}{_hidden(diagnosis.gap)}"
            f"{f'. It stands out most at {where}' if where else ''}."
        )
    if diagnosis.verdict == "unexplained":
        return (
            f"The gap is not explained: {_found(diagnosis.effects)} fits the fitted recordings "
            f"best, but {error} of those held out is {before} before and {after} after, where "
            f"{noise}."
        )
    finer = diagnosis.gap.finer_position
    if finer is not None and _shrinks(finer) and not _shrinks(diagnosis.gap.position):
        # The timestep's error hides at its own size what was mended.
        error = "at a quarter of the simulation's timestep the position error"
        moved = "shrinks from {} to {}".format(*span((finer.before, finer.after), finer.unit))
        noise = _floors(diagnosis.gap, "position", diagnosis.gap.position)
    complete = diagnosis.verdict == "explained"
    left = "" if complete or not diagnosis.remaining else spot(diagnosis.remaining[0])
    return (
        f"{'The gap' if complete else 'Part of the gap'} is explained by "
        f"{_found(diagnosis.effects)}: {error} {moved}, where {noise}{_hidden(diagnosis.gap)}"
        f"{f'. What remains stands out most at {left}' if left else ''}."
    )


def _hidden(gap: Gap) -> str:
    """The joint with the most of a gap that all joints together hide; empty where none does."""
    if not gap.hidden_joints:
        return ""
    joint = gap.hidden_joints[0]
    size = gap.joints[joint]
    left, floor = (quantity(one, size.unit) for one in (size.after, size.floor))
    return f"; at {label(joint)} alone it is {left}, over a floor of {floor}"


def _nothing_explains(diagnosis: Diagnosis) -> str:
    if not diagnosis.searched or diagnosis.only == ():
        return "Simulation and measurement disagree"
    if diagnosis.only is None:
        return "No effect of the catalogue explains the gap"
    return f"The gap is not explained by {listed(diagnosis.only, 'or')}, the only effects tried"


def signals(gap: Gap) -> dict[str, GapSize]:
    """The gap of every signal, position first."""
    others = {name: size for name, size in gap.signals.items() if name != "position"}
    return {"position": gap.position} | others


def size_columns(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What a table says of each gap; without effects there is no before and after."""
    sizes = ("before", "after") if diagnosis.effects else ("gap",)
    return (*sizes, "noise floor")


def size_cells(diagnosis: Diagnosis, size: GapSize) -> tuple[str, ...]:
    """One gap under the `size_columns`."""
    sizes = (size.before, size.after) if diagnosis.effects else (size.before,)
    return tuple(quantity(value, size.unit) for value in (*sizes, size.noise_floor))


def telling(gap: Gap) -> tuple[str, GapSize]:
    """The position gap; another signal's where that shrinks and position hides it, or is all."""
    ratios = {
        name: size.after / size.before for name, size in signals(gap).items() if size.before > 0
    }
    best = min(ratios, key=lambda name: ratios[name], default="position")
    hidden = ratios.get("position", 1.0) > _SHRUNK and ratios.get(best, 1.0) <= _SHRUNK
    if hidden:
        return best, gap.signals[best]
    left = {name: size for name, size in gap.besides.items() if not size.at_floor}
    if left and gap.position_at_floor and not _shrinks(gap.position):
        return max(left.items(), key=lambda one: one[1].after / one[1].floor)
    return "position", gap.position


def _shrinks(size: GapSize) -> bool:
    return size.after <= _SHRUNK * size.before


def basis(diagnosis: Diagnosis) -> str:
    """On what the gap was measured."""
    gap = diagnosis.gap
    whole = {*diagnosis.held_out} <= {*diagnosis.recordings}
    names = f" ({listed(_some(diagnosis.held_out))})" if diagnosis.held_out else ""
    what = f"recordings{names}" if whole else "blocks of time of the recordings"
    replay = (
        "over whole rollouts"
        if gap.horizon is None
        else f"over windows of {gap.horizon:g} s that restart from the measured state"
    )
    if not gap.held_out:
        return (
            f"Root-mean-square error {replay}, on what was fitted: it has a gap that the held-out "
            f"{what} do not show."
        )
    return f"Root-mean-square error, on held-out {what}, which no fit has seen, {replay}."


def doubts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """One paragraph for each confusion set."""
    return tuple(_doubt(named) for named in diagnosis.effects if named.indistinguishable_from)


def _doubt(named: NamedEffect) -> str:
    same = dict(named.equivalent)
    close = [label(name) for name in named.indistinguishable_from if name not in same]
    parts = []
    if same:
        parts.append(
            f"{step(named)} and {listed([label(name) for name in same])} leave the same log, "
            "whatever is commanded."
        )
        parts += dict.fromkeys(same.values())
    if close:
        parts.append(
            f"With these recordings, {step(named)} cannot be told from {listed(close, 'or')}: each "
            "fits equally well within the noise."
        )
    parts.append(
        "The mended model moves like the robot either way, but the cause, and the numbers given "
        "for it, may be another's."
    )
    return " ".join(parts)


def advice(diagnosis: Diagnosis) -> str:
    """What to record next, or "" where nothing needs it."""
    wanted = diagnosis.next_experiment
    if wanted is None:
        if not doubts(diagnosis):
            return ""
        return diagnosis.obstacle or (
            "No experiment of the battery that this robot can be put through is predicted to tell "
            "them apart with the signals that were logged."
        )
    between = [label(name) for name in wanted.between]
    told = f"{listed(between)} apart" if len(between) > 1 else f"where {between[0]} is"
    return f"{_task(wanted)} It is predicted to tell {told} by {separation(wanted.separation)}."


def _task(wanted: NextExperiment) -> str:
    """What to do, as instructions."""
    sent = label(wanted.file) if wanted.file else "the targets"
    play = f"Send {sent} to the robot (the excitation {label(wanted.excitation)}), record what"
    if wanted.excitation == RELEASE:
        play = f"The pose to let go from is in the first row of {sent}. Record what"
    ends = "and diagnose again with the old recordings and the new one"
    if wanted.model:
        ends += (
            f", which belongs to {label(wanted.model)}, your model with this change: list both in "
            "an experiments.toml"
        )
    prepare = f"{label(wanted.instruction)} " if wanted.instruction else ""
    return f"{prepare}{play} it does, {ends}."


def separation(sigmas: float) -> str:
    """A predicted difference in words."""
    if sigmas > _FAR:
        return f"more than {_FAR} standard deviations"
    sure = "" if sigmas >= _PARTS_CLEARLY else ", which may not be enough"
    return f"{sigmas:.1f} standard deviations{sure}"


def unknown(diagnosis: Diagnosis) -> str:
    """How probable it is that something is missing that has no name here; or ""."""
    if diagnosis.unknown is None or diagnosis.verdict == "no_gap":
        return ""
    probable = f"is {percent(diagnosis.unknown)} probable."
    if diagnosis.verdict == "explained":
        return f"That something is missing besides, which the catalogue cannot name, {probable}"
    besides = " besides" if diagnosis.effects else ""
    remains = f"A gap remains, so something is missing{besides}."
    effort = "effort that goes smoothly with how the joints move and are loaded"
    if not diagnosis.unknown:
        return f"{remains} No {effort} makes up for it."
    return f"{remains} That it is an {effort}, which the catalogue cannot name, {probable}"


def sure(confidence: float) -> str:
    """A confidence; resampling cannot say that anything is certain."""
    return percent(min(confidence, _MOST_SURE))


def hint_gap(hint: Hint) -> str:
    """What a stopgap would make of the gap."""
    what = (
        "effort that the model lacks"
        if hint.kind == "formula"
        else f"{words(hint.signal)} error of {label(hint.joint)}"
    )
    size = hint.size
    with_it, without = (quantity(value, size.unit) for value in (size.after, size.before))
    return f"the {what} would be {with_it} instead of {without} on held-out recordings"


def _found(effects: Sequence[NamedEffect]) -> str:
    found = []
    for named in effects:
        others = [label(name) for name in named.indistinguishable_from]
        doubt = f", could also be {listed(others, 'or')}" if others else ""
        found.append(f"{step(named)} ({sure(named.confidence)} sure{doubt})")
    return listed(found)


def _floors(gap: Gap, signal: str, size: GapSize) -> str:
    floor = quantity(size.noise_floor, size.unit)
    noise = f"the noise of the measurement alone would leave {floor}"
    if not size.numerical_floor > size.noise_floor:
        return noise
    own = "timestep and soft dry friction" if gap.drier else "timestep"
    return f"{noise} and the {own} of the simulation {quantity(size.numerical_floor, size.unit)}"
