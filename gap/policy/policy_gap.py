"""What a gap means for a policy: which of the named effects breaks it.

def make_environment(robot):                        # a gap.policy.policy_robot.PolicyRobot
    walker = robot.walker()                         # with all that was found
    return composer.Environment(TrackVelocity(walker), time_limit=8.0)

found = gap.policy_gap(make_environment, "walk.onnx", result)
print(found)                                        # who breaks it, and a table
found.save("out")                                   # policy.json, policy.html
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from walkerkit.gap.deliver.findings import Findings
from walkerkit.gap.errors import InputError
from walkerkit.gap.policy.loading import Policy, load_policy
from walkerkit.gap.policy.outcome import MEASURES, Judgement, Measure, Outcome, judged
from walkerkit.gap.policy.policy_robot import PolicyRobot, check_in_place
from walkerkit.gap.policy.policy_variants import Cast, Variant, findings_of, variants
from walkerkit.gap.policy.rollout import (
    Tracking,
    draws_a_start,
    random_state,
    roll_out,
    tracking_of,
)
from walkerkit.gap.policy.statistics import LEVEL
from walkerkit.gap.recordings.given import is_callable
from walkerkit.gap.report.diagnosis import json_text
from walkerkit.gap.report.output import write_folder
from walkerkit.gap.report.result import Result
from walkerkit.gap.search.effort import Progress
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import with_sidecar
from walkerkit.gap.simulation.users_code import blamed_on, function_named

MakeEnvironment = Callable[[PolicyRobot], Any]

FILE, PAGE, KIND = "policy.json", "policy.html", "policy"
SCHEMA = 1
_FEWEST = 3  # episodes, of which an interval can be made


@dataclass(frozen=True, kw_only=True)
class PolicyGap:
    """What the named effects do to a policy.

    Attributes:
        outcomes: how it did on each robot; the first is the one that was given.
        judgement: what is lost, by what.
        measure: by what it is judged: `return`, `falls` or `tracking`.
        share: what may be lost, of what it has as given; of falls, of the episodes.
        tracking: what is tracked, and its unit; None where nothing is.
        next_experiment: that of the diagnosis, where its members leave another policy's fate; None
            where no experiment would change the answer, or none is known.
        notes: what a reader should know.
    """

    outcomes: tuple[Outcome, ...]
    judgement: Judgement
    measure: Measure
    share: float
    tracking: tuple[str, str] | None
    next_experiment: dict[str, Any] | None
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<PolicyGap: {self.judgement.verdict}; {', '.join(self.blamed) or 'none blamed'}>"

    def __str__(self) -> str:
        from walkerkit.gap.policy.policy_console import as_text

        return as_text(self)

    @property
    def blamed(self) -> tuple[str, ...]:
        """The effects that break the policy, that which takes most first."""
        return tuple(one.effect for one in self.judgement.parts if one.verdict == "breaks")

    def to_dict(self) -> dict[str, Any]:
        """The content of policy.json."""
        from walkerkit.gap.policy.policy_wording import answer, next_step

        of = self.judgement
        episodes = self.outcomes[0].episodes
        return {
            "schema": SCHEMA,
            "verdict": of.verdict,
            "blamed": list(self.blamed),
            "answer": answer(self),
            "measure": self.measure,
            "level": LEVEL,
            "margin": {"share": self.share, "value": of.margin},
            "seeds": [one.seed for one in episodes],
            "loss": of.loss.to_dict(),
            "effects": [one.to_dict() for one in of.parts],
            "rivals": [one.to_dict() for one in of.rivals],
            "next": next_step(self),
            "next_experiment": self.next_experiment,
            "tracking": None
            if self.tracking is None
            else dict(zip(("what", "unit"), self.tracking, strict=True)),
            "variants": [one.to_dict() for one in self.outcomes],
            "notes": list(self.notes),
        }

    def to_json(self) -> str:
        """policy.json; numbers carry six significant digits."""
        return json_text(self.to_dict())

    def save(self, folder: str | Path, *, overwrite: bool = True) -> Path:
        """Writes policy.json and policy.html.

        Args:
            folder: made if it is missing.
            overwrite: whether files may be replaced that no such run has left.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be written, or a file is in the way.
        """
        from walkerkit.gap.policy.policy_page import write_page

        def write(made: Path) -> None:
            write_page(self, made / PAGE)
            (made / FILE).write_text(self.to_json(), encoding="utf-8")

        return write_folder(Path(folder), write, run={"kind": KIND}, overwrite=overwrite)


def policy_gap(
    make_environment: MakeEnvironment | str,
    policy: Policy | str | Path,
    result: Result | str | Path,
    *,
    model: str | Path | None = None,
    effects: str | Sequence[str] = (),
    episodes: int = 10,
    seed: int = 0,
    seconds: float | None = None,
    measure: Measure = "return",
    margin: float = 0.1,
    allow_outside: bool = False,
    progress: Progress | None = None,
) -> PolicyGap:
    """Rolls a policy out on the robot as given, as mended, and with each effect.

    The same seeds begin the episodes of every robot, so that losses are differences of pairs.

    Args:
        make_environment: a function of the robot that returns a dm_control environment with it; or
            its name, `package.module:callable`.
        policy: a function of a TimeStep that returns an action; or an `.onnx` file, a `.pt` file of
            TorchScript, or `package.module:callable`.
        result: what `diagnose` has returned, or the folder that it was saved in.
        model: the model that the policy was made for, where it is not the one that was diagnosed,
            as where that hung; needed with a folder.
        effects: names of the effects that count; by default all that were named.
        episodes: how many for each robot.
        seed: of the first episode; the others' follow it.
        seconds: how long an episode is at most [s]; by default until the environment ends it.
        measure: by what the policy is judged: `return`, `falls`, or `tracking`.
        margin: what it may lose, as a share of what it has in the model as given; of falls, of the
            episodes.
        allow_outside: the model's files may lie outside of its folder.
        progress: called with what is being done and how far it is.

    Returns:
        What each effect does to the policy.

    Raises:
        InputError: an argument cannot be used, or an effect cannot be put into the environment.
    """
    _check(episodes, seconds, measure, margin)
    wanted = (effects,) if isinstance(effects, str) else tuple(effects)
    made = _maker(make_environment)
    given = _given(result, model, allow_outside)
    found = findings_of(result, given)
    cast = variants(found, given, wanted)
    asked = load_policy(policy)
    seeds = range(seed, seed + episodes)
    outcomes, tracking, drawn = _rolled_out(cast.variants, made, asked, seeds, seconds, progress)
    return _judged(cast, found, outcomes, tracking, drawn, measure=measure, margin=margin)


def _judged(
    cast: Cast,
    found: Findings,
    outcomes: Sequence[Outcome],
    tracking: Tracking | None,
    drawn: bool,
    *,
    measure: Measure,
    margin: float,
) -> PolicyGap:
    """What the outcomes of all robots say.

    Raises:
        InputError: the policy cannot be judged by that.
    """
    _check_measured(outcomes, measure)
    judgement = judged(outcomes, cast.effects, measure=measure, margin=margin)
    return PolicyGap(
        outcomes=tuple(outcomes),
        judgement=judgement,
        measure=measure,
        share=margin,
        tracking=_told(tracking),
        next_experiment=_next_experiment(judgement, found.content),
        notes=(*cast.notes, *_notes(outcomes, drawn=drawn)),
    )


def _check(episodes: int, seconds: float | None, measure: str, margin: float) -> None:
    if episodes < _FEWEST:
        raise InputError(
            f"episodes is {episodes}: of so few nothing can be said. Give {_FEWEST} or more."
        )
    if seconds is not None and not 0 < seconds < np.inf:
        raise InputError(f"seconds is {seconds}. Give a length above 0, or leave it out.")
    if measure not in MEASURES:
        raise InputError(f"measure is {measure!r}. Give one of {', '.join(MEASURES)}.")
    if not 0 < margin < 1:
        raise InputError(f"margin is {margin}. Give a share between 0 and 1, such as 0.1.")


def _maker(make: MakeEnvironment | str) -> MakeEnvironment:
    if isinstance(make, str):
        if not is_callable(make):
            raise InputError(
                f"the environment is {make!r}. Give package.module:callable, a function of the "
                "robot that returns an environment with it."
            )
        return function_named(make, "an environment for a robot")
    if not callable(make):
        raise InputError(
            f"make_environment is an object of type {type(make).__name__}. Give a function of the "
            "robot that returns an environment with it: one environment has one robot."
        )
    return make


def _given(result: Any, model: str | Path | None, allow_outside: bool) -> Robot:
    """The robot that the policy was made for."""
    if model is None:
        if isinstance(result, Result):
            if len(result.robots) == 1:
                return result.problem.robots[0]
            raise InputError(
                f"the diagnosis is of {len(result.robots)} models. Give as `model` that in which "
                "the policy runs."
            )
        raise InputError(
            f"{result}: a folder has the mended model alone. Give as `model` the one that was "
            "given, in which the policy runs."
        )
    robot = load_robot(model, floating=True, allow_outside=allow_outside)
    return robot if robot.path is None else with_sidecar(robot, robot.path)


def _rolled_out(
    cast: Sequence[Variant],
    make: MakeEnvironment,
    policy: Policy,
    seeds: range,
    seconds: float | None,
    progress: Progress | None,
) -> tuple[list[Outcome], Tracking | None, bool]:
    """The outcome of each robot, what is tracked, and whether starts are drawn."""
    outcomes, before, tracking, drawn = list[Outcome](), None, None, True
    given = cast[0].robot.robot
    for number, variant in enumerate(cast):
        if progress:
            progress(variant.name, number / len(cast))
        environment = _environment(make, variant, seeds[0])
        model = environment.physics.model.ptr
        before = model if before is None else before
        check_in_place(given, variant.robot, before, model)
        if variant.kind == "given":
            drawn = draws_a_start(environment, seeds[:2])
            tracking = tracking_of(environment)
        rolled = roll_out(environment, policy, seeds=seeds, seconds=seconds)
        environment.close()
        outcomes.append(Outcome.of(variant, rolled))
    return outcomes, tracking, drawn


def _environment(make: MakeEnvironment, variant: Variant, seed: int) -> Any:
    """An environment with a robot, after a reset."""
    name = getattr(make, "__name__", type(make).__name__)
    with blamed_on(
        f"make_environment {name!r}, {variant.name}",
        "It is called with the robot and returns a dm_control environment.",
    ):
        environment = make(variant.robot)
    random_state(environment).seed(seed)
    environment.reset()
    return environment


def _check_measured(outcomes: Sequence[Outcome], measure: Measure) -> None:
    given = outcomes[0]
    if measure == "tracking" and any(one.tracking is None for one in outcomes):
        raise InputError(
            "measure is 'tracking', and nothing is tracked: the task has no `tracking_error`, and "
            "no joint follows a position target. Give 'return' or 'falls'."
        )
    if measure != "falls" and not float(np.mean(given.costs(measure))):
        raise InputError(
            f"measure is {measure!r}, which is 0 in the model as given, so that it has no share to "
            "lose. Give another measure."
        )


def _told(tracking: Tracking | None) -> tuple[str, str] | None:
    return None if tracking is None else (tracking.what, tracking.unit)


def _next_experiment(judgement: Judgement, content: Any) -> dict[str, Any] | None:
    """The diagnosis' next experiment, where the answer hangs on which member it finds."""
    wanted: dict[str, Any] | None = content.get("next_experiment")
    return wanted if judgement.hangs_on else None


def _notes(outcomes: Sequence[Outcome], *, drawn: bool) -> list[str]:
    notes = []
    given = outcomes[0]
    if not drawn and len({one.total for one in given.episodes}) == 1:
        notes.append(
            "All episodes in the model as given are the same: the environment draws nothing, so "
            "that the intervals are those of one episode. Let it draw where an episode begins "
            "(joint_noise of walkerkit's tasks)."
        )
    fell = sum(one.fell for one in given.episodes)
    if 2 * fell > len(given.episodes):
        notes.append(
            f"The policy falls in {fell} of {len(given.episodes)} episodes in the model as given: "
            "it has little that an effect could break."
        )
    return notes
