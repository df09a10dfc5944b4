"""Robots whose joints are driven by more, or by something else, than one servo each."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from dm_control import composer

from benchmarks.robots.checks import own_log
from benchmarks.robots.written import WRITTEN
from tests.gap.simulation.follow import Follow
from walkerkit import gap
from walkerkit.actuators import ActuatorCmd


@pytest.fixture
def write(tmp_path):
    def written(name):
        path = tmp_path / f"{name}.xml"
        path.write_text(WRITTEN[name], encoding="utf-8")
        return path

    return written


def recording(path, name="own"):
    return gap.Recording(name=name, **own_log(mujoco.MjModel.from_xml_path(str(path))))


def renamed(log, old, new):
    columns = {new if name == old else name: v for name, v in log.columns.items()}
    return replace(log, columns=columns)


def test_a_gripper_on_a_tendon_is_told_of_in_one_sentence_or_leaves_no_gap(write):
    path = write("gripper_on_a_tendon")
    log = recording(path)
    found = gap.compare(path, [log], n_threads=1)
    assert found.verdict == "no_gap"
    assert not any("passive" in note or "driven by effort" in note for note in found.notes)
    wrong = renamed(log, "grip/position_target", "left_finger/position_target")
    with pytest.raises(gap.InputError, match="Rename the column to `grip/position_target`"):
        gap.compare(path, [wrong], n_threads=1)
    without = {k: v for k, v in log.columns.items() if k != "grip/position_target"}
    with pytest.raises(gap.InputError, match="drives the tendon 'split'"):
        gap.compare(path, [replace(log, columns=without)], n_threads=1)


def test_volts_are_volts(write):
    path = write("dc_motors")
    log = recording(path)
    as_effort = renamed(log, "elbow/voltage_target", "elbow/effort_target")
    for one, told in ((log, False), (as_effort, True)):
        found = gap.compare(path, [one], n_threads=1)
        assert found.verdict == "no_gap"
        notes = [note for note in found.notes if "was read in volts" in note]
        assert bool(notes) == told
        assert not told or "Call it elbow/voltage_target" in notes[0]


class FollowPair(Follow):
    """Velocities beside the positions."""

    def before_step(self, physics, action, random_state):
        position, velocity = np.split(self._targets[self._row], 2)
        self._walker.command = ActuatorCmd(position_target=position, velocity_target=velocity)
        self._row += 1

    def initialize_episode(self, physics, random_state):
        joints = physics.bind(self._walker.observable_joints)
        joints.qpos, joints.qvel, self._row = self._targets[0][:2], 0.0, 0


def test_the_mended_pair_is_a_walker_and_so_is_its_file(write, tmp_path):
    path = write("pair")
    stiff = WRITTEN["pair"].replace('damping="0.1"', 'damping="0.1" frictionloss="0.3"')
    model = mujoco.MjModel.from_xml_string(stiff)
    logs = [gap.Recording(name="a", **own_log(model)), gap.Recording(name="b", **own_log(model))]
    found = gap.diagnose(path, logs, effects=["coulomb_friction"], n_threads=1)
    assert [named.effect for named in found.effects] == ["coulomb_friction"]
    found.save(tmp_path / "out")
    from walkerkit.walkers import MjcfWalker

    walkers = [found.walker(), MjcfWalker.from_file(tmp_path / "out" / "model.xml")]
    step, rows = model.opt.timestep, 300
    time = step * np.arange(rows)
    wave = 0.3 * np.sin(8 * time)
    targets = np.stack([wave, -wave, 0 * wave, 2.4 * np.cos(8 * time)], axis=1)
    data = mujoco.MjData(found.model)
    data.qpos[:] = targets[0, :2]
    for row in targets:
        data.ctrl[:] = row[0], row[1], row[3]
        mujoco.mj_step(found.model, data)
    for walker in walkers:
        environment = composer.Environment(
            FollowPair(walker, targets, step), random_state=0, legacy_step=False
        )
        environment.reset()
        for _ in range(rows):
            environment.step(np.zeros(walker.action_spec.shape))
        np.testing.assert_allclose(environment.physics.data.qpos, data.qpos, atol=1e-7)


MOTOR = """
<mujoco>
  <option timestep="0.01" integrator="RK4"/>
  <worldbody><body>
    <joint name="knee" axis="0 1 0" damping="0.05" armature="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
  </body></worldbody>
  <actuator><motor joint="knee"/></actuator>
</mujoco>
"""


def test_a_coarse_timestep_leaves_no_gap_in_its_own_log_of_efforts(tmp_path):
    path = tmp_path / "motor.xml"
    path.write_text(MOTOR, encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rows = mujoco.MjData(model), 600
    time = model.opt.timestep * np.arange(rows)
    effort = 0.2 * np.sin(5 * time) + 0.1 * np.sin(9 * time + 1)
    position = np.empty(rows)
    for row in range(rows):
        data.ctrl[:], position[row] = effort[row], data.qpos[0]
        mujoco.mj_step(model, data)
    position += 2e-5 * np.random.default_rng(0).standard_normal(rows)
    columns = {"knee/position": position, "knee/effort_target": effort}
    found = gap.compare(path, [gap.Recording(name="own", time=time, columns=columns)], n_threads=1)
    assert found.verdict == "no_gap"
    assert found.gap.position.before < 5e-4
