"""Diagnoses robots side by side and compares them; see the package."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from walkerkit.gap.errors import InputError
from walkerkit.gap.fleet import folder as folders
from walkerkit.gap.fleet.comparison import Comparison, Row, compare
from walkerkit.gap.fleet.engine import PROCESSES, Done, Failure, check_engine, run
from walkerkit.gap.fleet.fleet_console import as_text
from walkerkit.gap.fleet.fleet_page import write_page
from walkerkit.gap.fleet.manifest import Member, load_fleet
from walkerkit.gap.fleet.member import Job, Made, diagnose_member
from walkerkit.gap.recordings.checks import check_seconds
from walkerkit.gap.report.output import DIAGNOSIS, check_folder, check_free, write_folder

if TYPE_CHECKING:
    from walkerkit.gap.effects import Effect
    from walkerkit.gap.workflow import OneOrMoreEffects

SCHEMA = 1
JSON, REPORT = "fleet.json", "fleet.html"
KIND = "fleet"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one robot.

    Attributes:
        robot: its name.
        diagnosis: the content of its diagnosis.json, or None.
        failure: why there is none, or None.
        kept: whether it was diagnosed by an earlier run.
    """

    robot: str
    diagnosis: Mapping[str, Any] | None
    failure: Failure | None = None
    kept: bool = False


Ended = Callable[[Outcome, int, int], None]
"""Called with an outcome as it comes, the number of outcomes so far, and that of robots."""


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The outcomes of all robots, and what those that were diagnosed have in common.

    Attributes:
        outcomes: one per robot, in the order of the fleet's file.
        comparison: of the robots that have a diagnosis.
    """

    outcomes: tuple[Outcome, ...]
    comparison: Comparison

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """The robots that have no diagnosis."""
        return tuple(outcome for outcome in self.outcomes if outcome.failure is not None)

    def __str__(self) -> str:
        return as_text(self)

    def to_json(self) -> str:
        """fleet.json: the same input gives the same bytes but for `seconds`, on any engine."""
        content = {
            "schema": SCHEMA,
            "robots": [_robot(outcome) for outcome in self.outcomes],
            "effects": [_effect(row) for row in self.comparison.rows],
        }
        return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def diagnose_fleet(
    manifest: str | Path,
    out: str | Path,
    *,
    engine: str = PROCESSES,
    address: str | None = None,
    workers: int | None = None,
    window: float | None = None,
    effects: OneOrMoreEffects | None = None,
    n_threads: int = 1,
    allow_code: bool = False,
    allow_outside: bool = False,
    overwrite: bool = False,
    ended: Ended | None = None,
) -> Fleet:
    """Diagnoses every robot of a fleet and writes what was found.

    Each robot gets a folder of its own in `out`, as `diagnose` writes it; `fleet.json` and
    `fleet.html` compare them. A robot that cannot be diagnosed has a `failure.txt` there instead.

    Args:
        manifest: a `fleet.toml`.
        out: made if it is missing.
        engine: what runs the diagnoses: `processes` of this machine, `ray` or `dask`.
        address: of a cluster that runs, whose machines see the recordings by the same paths; by
            default Ray or Dask are started here.
        workers: how many robots at a time, by default as many as there are cores.
        window: as for `diagnose`.
        effects: as for `diagnose`.
        n_threads: threads of each robot's simulation.
        allow_code: the fleet's file, or a manifest that it names, may name
            `package.module:callable` as a model.
        allow_outside: as for `diagnose`.
        overwrite: diagnose robots again that `out` has with the same input, and replace files
            there that no fleet has left.
        ended: called with each robot's outcome as it comes.

    Raises:
        InputError: the manifest, the folder or the engine cannot be used.
    """
    from walkerkit.gap.workflow import effects_to_send

    members = load_fleet(manifest, allow_code=allow_code)
    check_engine(engine, address, workers)
    chosen = effects_to_send(effects)
    check_seconds(window)
    out = Path(out)
    check_folder(out)
    jobs = _jobs(
        members, window, chosen, n_threads, allow_code=allow_code, allow_outside=allow_outside
    )
    if not overwrite:
        _check_untouched(out, jobs)
    diagnosed = partial(run, diagnose_member, engine=engine, address=address, workers=workers)
    outcomes = _outcomes(out, jobs, diagnosed, overwrite=overwrite, ended=ended)
    diagnoses = {one.robot: one.diagnosis for one in outcomes if one.diagnosis is not None}
    fleet = Fleet(outcomes=outcomes, comparison=compare(diagnoses))
    _write(fleet, out, title=Path(manifest).stem, overwrite=overwrite)
    return fleet


def _write(fleet: Fleet, out: Path, *, title: str, overwrite: bool) -> None:
    """Writes what compares the robots."""

    def write(made: Path) -> None:
        (made / JSON).write_text(fleet.to_json(), encoding="utf-8")
        write_page(fleet, made / REPORT, title=title)

    write_folder(out, write, run={"kind": KIND}, overwrite=overwrite)


def _jobs(
    members: Sequence[Member],
    window: float | None,
    effects: tuple[str | Effect, ...] | None,
    n_threads: int,
    *,
    allow_code: bool,
    allow_outside: bool,
) -> list[Job]:
    """One for each robot."""
    return [
        Job(
            member=member,
            window=window,
            effects=effects,
            n_threads=n_threads,
            allow_code=allow_code,
            allow_outside=allow_outside,
            folder=str(Path.cwd()),
        )
        for member in members
    ]


def _check_untouched(out: Path, jobs: Sequence[Job]) -> None:
    """Raises InputError where a folder has what this run would replace."""
    check_free(out, (JSON, REPORT), kind=KIND, overwrite=False)
    for job in jobs:
        folders.check_robot(out / job.member.name, job)


def _outcomes(
    out: Path,
    jobs: Sequence[Job],
    diagnosed: Callable[[Sequence[Job]], Iterator[Done[Made]]],
    *,
    overwrite: bool,
    ended: Ended | None,
) -> tuple[Outcome, ...]:
    """What becomes of each robot, in the order of the jobs.

    Args:
        out: the fleet's folder.
        jobs: one for each robot.
        diagnosed: does jobs.
        overwrite: whether what an earlier run has left is done again.
        ended: called with each outcome as it comes.
    """
    outcomes: dict[str, Outcome] = {}

    def add(outcome: Outcome) -> None:
        outcomes[outcome.robot] = outcome
        if ended is not None:
            ended(outcome, len(outcomes), len(jobs))

    left = []
    for job in jobs:
        name = job.member.name
        diagnosis = None if overwrite else folders.kept(out / name, job)
        if diagnosis is None:
            left.append(job)
        else:
            add(Outcome(robot=name, diagnosis=diagnosis, kept=True))
    for done in diagnosed(left):
        add(_written(out, left[done.index].member.name, done, overwrite))
    return tuple(outcomes[job.member.name] for job in jobs)


def _written(out: Path, robot: str, done: Done[Made], overwrite: bool) -> Outcome:
    """Writes what came back of a robot."""
    if done.value is None:
        failure = done.failure or Failure(message="nothing came back")
        folders.write_failure(out / robot, failure, overwrite=overwrite)
        return Outcome(robot=robot, diagnosis=None, failure=failure)
    try:
        folders.write_made(out / robot, done.value, overwrite=overwrite)
    except InputError as error:  # an asset's name is known only now
        failure = Failure(message=str(error), refused=True)
        return Outcome(robot=robot, diagnosis=None, failure=failure)
    return Outcome(robot=robot, diagnosis=folders.read_diagnosis(done.value.files[DIAGNOSIS]))


def _robot(outcome: Outcome) -> dict[str, Any]:
    if outcome.diagnosis is None:
        message = "" if outcome.failure is None else outcome.failure.message
        return {"name": outcome.robot, "verdict": "failed", "failure": message}
    gap = outcome.diagnosis["gap"]
    return {
        "name": outcome.robot,
        "verdict": outcome.diagnosis["verdict"],
        "gap": {key: gap[key] for key in ("unit", "before", "after", "noise_floor")},
        "effects": [named["effect"] for named in outcome.diagnosis["effects"]],
        "seconds": outcome.diagnosis["seconds"],
    }


def _effect(row: Row) -> dict[str, Any]:
    place: Literal["body", "joint"] = "body" if row.body else "joint"
    return {
        "effect": row.effect,
        place: row.place,
        "shared": row.shared,
        "robots": list(row.robots),
        "possible": list(row.possible),
        "compared": list(row.compared),
        "parameters": [
            {
                "name": name,
                "unit": next(iter(of.values())).unit,
                "median": None
                if (middle := row.middle(name)) != middle
                else float(f"{middle:.6g}"),
                "robots": {
                    robot: {
                        "value": None if one.value != one.value else one.value,
                        "std": one.std,
                        "at_bound": one.at_bound,
                    }
                    for robot, one in of.items()
                },
            }
            for name, of in row.parameters.items()
        ],
    }
