"""Hints and stopgaps of a diagnosis: told as such, saved, and run by a walker as was said."""

import json
from dataclasses import replace

import numpy as np
import pytest
from dm_control import composer

from tests.gap.simulation.follow import Follow
from tests.gap.stopgap import rig
from walkerkit import gap
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.stopgap.closed_loop import can_close, closed_loop_gap
from walkerkit.gap.stopgap.learned_drive import learned_drive, runnable, why_none
from walkerkit.walkers import MjcfWalker
from walkerkit.walkers.saved import saved_actuators


def diagnosed(folder, recordings):
    path = folder / "arm.xml"
    path.write_text(rig.ARM, encoding="utf-8")
    return gap.diagnose(path, recordings, effects=["base_tilt"])


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    return diagnosed(tmp_path_factory.mktemp("soft"), rig.logs(drive=rig.soft))


def test_are_told_from_what_is_found(soft):
    assert soft.diagnosis.effects == ()
    kinds = {hint.kind: hint for hint in soft.diagnosis.hints}
    assert set(kinds) == {"formula", "learned"}
    learned = kinds["learned"]
    assert learned.size.after < 0.3 * learned.size.before
    assert learned.size.before == soft.diagnosis.gap.joints[rig.JOINT].after
    text = str(soft)
    assert "Stopgaps, which explain nothing" in text
    assert "A formula at shaft: missing effort ≈ " in text
    assert "stopgap_shaft.npz" in text


@pytest.mark.parametrize("constant", [False, True], ids=["short", "constant"])
def test_no_drive_is_learned_of_logs_that_say_nothing(soft, constant):
    def emptied(recording):
        few = slice(None) if constant else slice(0, 40)
        columns = {name: values[few].copy() for name, values in recording.columns.items()}
        if constant:
            columns[f"{rig.JOINT}/effort"][:] = 0.25
        return replace(recording, time=recording.time[few], columns=columns)

    half = soft.problem.fit
    recordings = tuple(tuple(emptied(r) for r in group) for group in half.recordings)
    problem = replace(soft.problem, fit=replace(half, recordings=recordings))
    assert learned_drive(problem, soft.robots[0], rig.JOINT, before=1.0) is None


def test_are_in_the_json(soft):
    first, second = json.loads(soft.diagnosis.to_json())["hints"]
    assert (first["kind"], first["joint"], first["file"]) == ("formula", rig.JOINT, None)
    assert (second["kind"], second["unit"]) == ("learned", "rad")
    assert second["after"] < second["before"]


def test_the_saved_drive_moves_a_walker_as_was_said(soft, tmp_path):
    soft.save(tmp_path)
    saved = saved_actuators(tmp_path / "model.xml", stopgap=True)
    (recording,) = soft.problem.held.recordings[0]
    targets = recording.columns[f"{rig.JOINT}/position_target"][:, None]
    walker = MjcfWalker.from_file(tmp_path / "model.xml", saved.actuators, laws=saved.laws)
    environment = composer.Environment(
        Follow(walker, targets, rig.STEP), random_state=0, legacy_step=False
    )
    environment.reset()
    joints = environment.physics.bind(walker.observable_joints)
    (q, qd) = MeasuredState(recording, [rig.JOINT]).at(recording.time[:1])
    joints.qpos, joints.qvel = q[0], qd[0]
    path = [float(joints.qpos[0])]
    for _ in range(len(targets) - 1):
        environment.step(np.zeros(1))
        path.append(float(joints.qpos[0]))
    error = np.array(path) - recording.columns[f"{rig.JOINT}/position"]
    (drive,) = soft.stopgaps
    assert np.sqrt(np.mean(error**2)) == pytest.approx(drive.after, rel=1e-4)
    # By default the walker has the drive of its model.
    assert saved_actuators(tmp_path / "model.xml").actuators != saved.actuators


def test_a_loop_that_runs_away_is_infinitely_bad(soft):
    (drive,) = soft.stopgaps
    wild = replace(drive, trained=replace(drive.trained, pos_scale=-100 * drive.trained.pos_scale))
    gap_of_it = closed_loop_gap(
        soft.problem, soft.problem.held, soft.robots[0], rig.JOINT, runnable(wild), lag=0
    )
    assert gap_of_it > 10 * drive.before


def test_joints_that_cannot_be_replaced(soft):
    (robot,) = soft.robots
    assert can_close(robot, rig.JOINT)
    with_law = replace(robot, laws={rig.JOINT: {"cogging": {}}})
    assert not can_close(with_law, rig.JOINT)
    assert why_none(soft.problem, robot, rig.JOINT) == ""
    assert "what is named acts in it" in why_none(soft.problem, with_law, rig.JOINT)


def test_no_hint_where_nothing_is_missing(tmp_path):
    result = diagnosed(tmp_path, rig.logs())
    assert result.diagnosis.hints == ()
    assert result.stopgaps == ()
    assert "hints" not in json.loads(result.diagnosis.to_json())
    assert not any("stopgap" in note for note in result.diagnosis.notes)


def test_that_there_is_none_is_said(tmp_path):
    def short(one):
        part = one.between(0.0, 0.3)
        columns = {k: v for k, v in part.columns.items() if not k.endswith("/effort")}
        return replace(part, name=one.name, columns=columns)

    diagnosis = diagnosed(tmp_path, [short(one) for one in rig.logs(drive=rig.soft)]).diagnosis
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.hints == ()
    formula, drive = diagnosis.notes[-2:]
    assert formula.startswith("There is no formula as a stopgap")
    assert drive.startswith("There is no learned drive at shaft as a stopgap: its effort was not")
