"""One robot of a fleet, diagnosed where a worker is.

A worker reads model and recordings, by the paths that the fleet's file gives; what it finds goes
back as the content of files, so that one process alone writes them.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from walkerkit.gap.fleet.manifest import Member

if TYPE_CHECKING:
    from walkerkit.gap.effects import Effect


@dataclass(frozen=True, kw_only=True)
class Job:
    """What a worker needs to know.

    Attributes:
        member: the robot.
        window, effects, n_threads, allow_code, allow_outside: as for `diagnose`.
        folder: where modules of callables are looked for, too.
    """

    member: Member
    window: float | None
    effects: tuple[str | Effect, ...] | None
    n_threads: int
    allow_code: bool
    allow_outside: bool
    folder: str


@dataclass(frozen=True, kw_only=True)
class Made:
    """What a worker brings back.

    Attributes:
        files: path in the robot's folder to content.
        key: what `input_key` says of the job.
    """

    files: Mapping[str, bytes]
    key: str


def diagnose_member(job: Job) -> Made:
    """Diagnoses one robot.

    Raises:
        InputError: its model or its recordings cannot be used.
    """
    key = input_key(job)
    from walkerkit.gap import workflow

    member = job.member
    result = workflow.diagnose(
        member.model,
        member.recordings,
        held_out=member.held_out,
        window=job.window,
        effects=job.effects,
        n_threads=job.n_threads,
        allow_code=job.allow_code,
        allow_outside=job.allow_outside,
    )
    with tempfile.TemporaryDirectory() as name:
        folder = result.save(name)
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
    return Made(files=files, key=key)


def input_key(job: Job) -> str:
    """A hash of everything that a diagnosis depends on: two jobs with one key have one result.

    Raises:
        InputError: the model or the recordings cannot be used.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")  # before dm_control looks for a display
    if job.folder not in sys.path:
        sys.path.append(job.folder)
    from walkerkit.gap.effects.effect import identity
    from walkerkit.gap.experiments.experiment import load_experiments
    from walkerkit.gap.report.claim import run_key
    from walkerkit.gap.workflow import prepare

    member = job.member
    setup = prepare(
        load_experiments(
            member.model,
            member.recordings,
            held_out=member.held_out,
            allow_code=job.allow_code,
            allow_outside=job.allow_outside,
        ),
        window=job.window,
        n_threads=job.n_threads,
        allow_outside=job.allow_outside,
    )
    effects = job.effects and tuple(e if isinstance(e, str) else identity(e) for e in job.effects)
    return run_key(setup.robots, (*setup.fitted, *setup.held_out), ("fleet", job.window, effects))
