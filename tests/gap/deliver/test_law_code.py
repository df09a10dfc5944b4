"""Exported laws are the library's own, on other arrays."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trainers.legs import leg_at
from tests.gap.deliver.robots import AWKWARD
from walkerkit.actuators.drivetrain import LAWS
from walkerkit.actuators.drivetrain.bank import LawBank
from walkerkit.actuators.drivetrain.drivetrain_law import Step
from walkerkit.gap.deliver.law_code import all_laws, driven, law_code

torch = pytest.importorskip("torch")
torch.set_num_threads(1)  # two joints are no work to share

SIZES = {
    "command_delay": {"delay": 0.0131},
    "sample_and_hold": {"period": 0.009},
    "setpoint_filter": {"time_constant": 0.013},
    "slew_limit": {"rate": 2.0},
    "controller_deadband": {"width": 0.6},
    "load_side_feedback": {"share": 0.7},
    "integral_action": {"gain": 30.0, "clamp": 0.5},
    "velocity_filter": {"time_constant": 0.02},
    "loop_delay": {"delay": 0.0057},
    "supply_voltage": {"share": 0.7, "nominal": 24.0},
    "supply_sag": {"sag": 0.01},
    "torque_speed_limit": {"saturation_effort": 6.0, "velocity_limit": 4.0},
    "actuator_lag": {"time_constant": 0.01},
    "strength_drift": {"rate": 0.3},
    "torque_ripple": {"amplitude": 0.2, "periods": 7.0, "phase": 0.3},
    "cogging": {"amplitude": 0.3, "periods": 9.0, "phase": 0.1},
    "quadratic_drag": {"drag": 0.04},
    "asymmetric_friction": {"forward": 0.2, "backward": 0.0},
    "stribeck_friction": {"breakaway": 0.3, "velocity": 0.2, "exponent": 1.4},
    "load_dependent_friction": {"coefficient": 0.1},
    "directional_efficiency": {"driving": 0.8, "backdriving": 1.1},
    "pose_dependent_friction": {"amplitude": 0.2, "periods": 5.0, "phase": 0.0},
    "presliding_friction": {"bristle_stiffness": 40.0},
}


def exported(text):
    made = {}
    exec(compile(text.replace("torch.float32", "torch.float64"), "drivetrain.py", "exec"), made)
    return made


def test_every_law_is_tried():
    assert {*SIZES} == {*LAWS}


@pytest.mark.parametrize("name", [*SIZES, "all of them"])
def test_it_makes_what_the_library_makes(name, tmp_path):
    robot = leg_at(tmp_path / "leg.xml", AWKWARD)
    chosen = SIZES if name == "all of them" else {name: SIZES[name]}
    robot = replace(robot, laws={"knee": chosen, "hip": dict([*chosen.items()][:1])})
    laws = all_laws(robot, delays=True, drag=True)
    code = exported(law_code(robot, laws, "torch"))
    numbers, dt = driven(robot, laws).numbers, robot.model.opt.timestep
    raw = {
        LAWS[law]: {
            p: np.array([laws[j].get(law, LAWS[law].neutral)[p] for j in ("hip", "knee")])
            for p in LAWS[law].parameter_names()
        }
        for law in driven(robot, laws).laws
    }
    bank = LawBank([*raw.items()], (2,), dt)
    random, state, time = np.random.default_rng(1), code["start"](), np.zeros(1)
    q, qd = np.array([0.1, -0.2]), np.zeros(2)
    moved = 0.0
    for k in range(50):
        target = 0.5 * np.sign(np.sin(0.21 * k)) * np.array([1.0, -1.0])
        qd = qd + random.normal(size=2) * 0.3
        q = q + dt * qd
        held, play = 0.1 * random.normal(size=2), 0.01 * random.normal(size=2)
        voltage = np.array([np.nan if k % 9 == 4 else 22.0 + random.normal()])
        zero = np.zeros(2)
        step = Step(
            dt=dt,
            time=time,
            q=q,
            qd=qd,
            stiffness=numbers["stiffness"],
            damping=numbers["damping"],
            limit=numbers["limit"],
            target=target.copy(),
            effort=zero,
            extra=zero.copy(),
            friction=zero.copy(),
            dry=numbers["dry"],
            held=held,
            play=play,
            play_speed=10 * play,
            voltage=voltage,
        )
        bank.run("controller", step)
        made = np.clip(40 * (step.target - q) * [1, 25 / 40] - qd, -9, 9)
        step.effort = made
        bank.run("drive", step)
        bank.run("joint", step)
        state, ctrl, applied, dry = code["before_step"](
            state, *map(torch.tensor, (target, q, qd, held, play, 10 * play, voltage))
        )
        np.testing.assert_allclose(ctrl.numpy(), step.target, rtol=1e-9, atol=1e-9)
        wanted = step.effort - made + step.extra
        np.testing.assert_allclose(applied.numpy(), wanted, rtol=1e-9, atol=1e-9)
        friction = np.maximum(step.dry + step.friction, 0.0)
        np.testing.assert_allclose(dry.numpy(), friction, rtol=1e-9, atol=1e-9)
        moved += np.abs(wanted).sum() + np.abs(friction - step.dry).sum()
        moved += np.abs(step.target - target).sum()
        time = time + dt
    assert moved > 0.1


def test_it_runs_many_robots_side_by_side(tmp_path):
    robot = replace(leg_at(tmp_path / "leg.xml", AWKWARD), laws={"hip": SIZES})
    code = exported(law_code(robot, all_laws(robot, delays=True, drag=True), "torch"))
    state = code["start"]((3,))
    zero = torch.zeros((3, 2), dtype=torch.float64)
    for _ in range(3):
        state, ctrl, applied, dry = code["before_step"](state, zero + 0.3, zero, zero + 1.0)
    assert ctrl.shape == applied.shape == dry.shape == (3, 2)
    assert torch.equal(applied[0], applied[2])
