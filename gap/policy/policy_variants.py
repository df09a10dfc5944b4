"""The robots that a policy is rolled out on: which there are, and with which effects each.

found = findings_of(result, given)
cast = variants(found, given, wanted=())
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from walkerkit.gap.deliver.findings import Findings, read_findings
from walkerkit.gap.deliver.reapply import reapplied
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.policy.policy_robot import PolicyRobot, as_given, meets, with_effects
from walkerkit.gap.report.result import Result
from walkerkit.gap.simulation.robot import Robot

Kind = Literal["given", "mended", "alone", "without", "rival"]


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A robot that a policy is rolled out on.

    Attributes:
        kind: `given`; `mended`, with all effects; with an effect `alone`, or `without` it; or with
            a `rival` in the place of one.
        effect: the effect that it is with or without, or the rival.
        in_place_of: what a rival stands for.
        robot: the robot.
    """

    kind: Kind
    effect: str = ""
    in_place_of: str = ""
    robot: PolicyRobot

    @property
    def name(self) -> str:
        """What it is, in words."""
        return {
            "given": "as given",
            "mended": "mended",
            "alone": f"with {self.effect} alone",
            "without": f"mended, without {self.effect}",
            "rival": f"mended, with {self.effect} for {self.in_place_of}",
        }[self.kind]


@dataclass(frozen=True, kw_only=True)
class Cast:
    """All robots that a policy is rolled out on.

    Attributes:
        effects: names of the effects that a policy meets.
        variants: the robots; the first is as it was given, and no two have the same effects.
        notes: what a user should know of how they were made.
    """

    effects: tuple[str, ...]
    variants: tuple[Variant, ...]
    notes: tuple[str, ...]


def findings_of(result: Result | str | Path, given: Robot | None) -> Findings:
    """A result, or what it has left in its folder.

    Args:
        result: what `diagnose` has returned, or the folder that it was saved in.
        given: the robot with the laws in Python that no folder holds, where it has some.

    Raises:
        InputError: it is none of these.
    """
    if isinstance(result, Result):
        return Findings(
            folder=Path("the diagnosis"),
            content=result.diagnosis.to_dict(),
            models=(),
            robot=result.robots[0],
        )
    if not isinstance(result, str | Path):
        raise InputError(
            f"the result is an object of type {type(result).__name__}. Give what gap.diagnose has "
            "returned, or the folder that it was saved in."
        )
    return read_findings(Path(result), given=given)


def variants(found: Findings, given: Robot, wanted: Sequence[str]) -> Cast:
    """Makes the robots.

    Args:
        found: the diagnosis.
        given: the robot as it was given.
        wanted: names of the effects that count; none for all.

    Raises:
        InputError: nothing was named, an effect is none that was, or cannot act on the robot.
    """
    names = _named(found, wanted)
    notes: list[str] = []

    def made(kind: Kind, kept: Sequence[str], effect: str = "") -> Variant:
        robot, told = reapplied(found, given, kept)
        notes.extend(told)
        return Variant(kind=kind, effect=effect, robot=with_effects(given, robot, kept))

    alone = {name: made("alone", (name,), name) for name in names}
    met = tuple(name for name in names if meets(given, alone[name].robot.robot))
    notes += [
        f"{name} changes nothing that a policy meets, so that it was not rolled out."
        for name in names
        if name not in met
    ]
    if not met:
        raise InputError(
            f"{found.folder}: of {', '.join(names)} nothing reaches a policy on this model. Give "
            "the model that the policy runs in as `model`, or a diagnosis with other effects."
        )
    # Of one effect, alone is mended; of two, each alone is mended without the other.
    cast = [
        Variant(kind="given", robot=as_given(given)),
        *(alone[name] for name in met if len(met) > 1),
        made("mended", met),
        *(
            made("without", tuple(other for other in met if other != name), name)
            for name in met
            if len(met) > 2
        ),
        *_rivals(found, given, wanted, notes),
    ]
    return Cast(
        effects=met,
        variants=tuple(cast),
        notes=tuple(dict.fromkeys(notes)),
    )


def _named(found: Findings, wanted: Sequence[str]) -> tuple[str, ...]:
    """The named effects that count.

    Raises:
        InputError: there are none, or one that is wanted is none of them.
    """
    names = tuple(dict.fromkeys(effect["effect"] for effect in found.effects))
    for name in wanted:
        if name not in names:
            raise InputError(
                f"effects: {name!r} was not named{closest(name, names)}; there "
                f"{'are' if len(names) > 1 else 'is'} {', '.join(names) or 'none'}. Name one of "
                "them, or leave it out."
            )
    names = tuple(name for name in names if not wanted or name in wanted)
    if not names:
        raise InputError(
            f"{found.folder}: nothing was named there, so that the mended model is the one that "
            "was given, and no effect can break a policy. Give a diagnosis that has named effects."
        )
    return names


def _rivals(
    found: Findings, given: Robot, wanted: Sequence[str], notes: list[str]
) -> Iterator[Variant]:
    """The members of the confusion set, each in its place."""
    rivals: list[dict[str, Any]] = found.content.get("rivals", [])
    for rival in rivals:
        if wanted and rival["in_place_of"] not in wanted:
            continue
        instead = replace(found, content={**found.content, "effects": rival["effects"]})
        names = tuple(dict.fromkeys(effect["effect"] for effect in rival["effects"]))
        kept = tuple(n for n in names if not wanted or n in wanted or n == rival["effect"])
        try:
            robot, told = reapplied(instead, given, kept)
        except InputError as error:
            notes.append(f"{rival['effect']} could not be put in place: {error}")
            continue
        notes.extend(told)
        yield Variant(
            kind="rival",
            effect=rival["effect"],
            in_place_of=rival["in_place_of"],
            robot=with_effects(given, robot, kept),
        )
    put = {(rival["in_place_of"], rival["effect"]) for rival in rivals}
    for effect in found.effects:
        left = [n for n in effect["indistinguishable_from"] if (effect["effect"], n) not in put]
        if left and (not wanted or effect["effect"] in wanted):
            notes.append(
                f"{effect['effect']} may as well be {', '.join(left)}, of which the diagnosis has "
                "no numbers, so that it was not rolled out."
            )
