from __future__ import annotations

import pytest

from walkerkit.gap.ingest.words import is_time, signal_of, time_unit


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("/joint_states/{}/position", "position"),
        ("/joint_commands/{}/position", "position_target"),
        ("/lowstate/motor_state[{}].tau_est", "effort"),
        ("/lowcmd/motor_cmd[{}].q", "position_target"),
        ("/lowcmd/motor_cmd[{}].tau", "effort_target"),
        ("motorState[{}].tauEst", "effort"),
        ("motorState[{}].ddq", None),
        ("motorState[{}].q_raw", None),
        ("dof_pos[{}]", "position"),
        ("des_dof_pos[{}]", "position_target"),
        ("dof_vel[{}]", "velocity"),
        ("observation.state[{}]", "position"),
        ("observation.state[{}.vel]", "velocity"),
        ("observation.effort[{}]", "effort"),
        ("action[{}]", "position_target"),
        ("/ctl/controller_state/reference.positions[{}]", "position_target"),
        ("/ctl/controller_state/feedback.velocities[{}]", "velocity"),
        ("/ctl/controller_state/error.positions[{}]", None),
        ("/ctl/controller_state/output.effort[{}]", None),
        ("/position_controller/commands/data[{}]", "position_target"),
        ("/effort_controller/commands/data[{}]", "effort_target"),
        ("q_des_{}", "position_target"),
        ("{}_torque", "effort"),
        ("foot_force[{}]", None),
        ("temperature", None),
    ],
)
def test_a_name_says_of_which_signal_it_is(name: str, signal: str | None) -> None:
    assert signal_of(name) == signal


@pytest.mark.parametrize("name", ["time", "__time", "timestamp_ns", "t", "t_cmd", "header.stamp"])
def test_names_of_clocks(name: str) -> None:
    assert is_time(name)


@pytest.mark.parametrize("name", ["hip/position", "tau", "temperature", "stamped_pos", "target"])
def test_names_of_others(name: str) -> None:
    assert not is_time(name)


def test_the_name_of_a_clock_may_have_its_unit() -> None:
    named = {"timestamp_us": "us", "time_ms": "ms", "tick": "ms", "t_ns": "ns", "time": None}
    assert {name: time_unit(name) for name in named} == named
