"""The states that segments start from: errors within their measurement are no gap, others are."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from walkerkit.gap import steps
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.starting_states import Starts
from walkerkit.gap.search.structure import Case, Structure
from walkerkit.gap.simulation.trials import Trials

Array = NDArray[np.float64]

ROWS, SEGMENTS, SECONDS = 50, 6, 0.5
SPANS = [slice(k * ROWS, (k + 1) * ROWS) for k in range(SEGMENTS)]
T = np.tile(np.linspace(0.0, SECONDS, ROWS), SEGMENTS)
# Of a joint that is damped: what a rad and what a rad/s more at the start change.
RESPONSES = np.stack([np.exp(-T), (1 - np.exp(-2 * T)) / 2])[..., None]
STD = np.array([1e-4, 2e-2])

LEG = """
<mujoco><compiler angle="radian"/><option timestep="0.0025"/><worldbody>
  <body pos="0 0 1"><joint name="hip" axis="0 1 0" armature="0.01" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.04" mass="2.2"/>
    <body pos="0 0 -0.35"><joint name="knee" axis="0 1 0" armature="0.01" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.03" mass="0.9"/></body></body>
</worldbody><actuator><motor joint="hip"/><motor joint="knee"/></actuator></mujoco>
"""


def starts(variance: float) -> Starts:
    durations = np.full(SEGMENTS, SECONDS)
    changes = STD[:, None, None] * RESPONSES
    return Starts(SPANS, durations, changes, np.array([variance]))


def off(seed: int) -> Array:
    """(1, rows, 1) what starts that are off by their errors change."""
    drawn = STD[:, None] * np.random.default_rng(seed).standard_normal((2, SEGMENTS))
    each = np.repeat(drawn, ROWS, axis=1)[..., None]
    changed: Array = np.sum(each * RESPONSES, axis=0, keepdims=True)
    return changed


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_what_starts_can_make_is_taken_out() -> None:
    noise = 1e-4 * np.random.default_rng(0).standard_normal((1, len(T), 1))
    made = off(1)
    left = made + noise
    starts(variance=1e-8).free(left)
    assert rms(made) > 15 * rms(noise)
    assert rms(left) < 1.1 * rms(noise)


def test_a_gap_that_is_larger_than_starts_can_make_stays() -> None:
    missing = 0.1 * np.sin(9 * T)[None, :, None]
    left = missing.copy()
    starts(variance=float(np.mean(missing**2))).free(left)
    assert rms(left - missing) < 0.03 * rms(missing)


def test_ridge_regression_of_every_segment_by_itself() -> None:
    variance, residuals = 3e-6, np.random.default_rng(2).standard_normal((2, len(T), 1))
    left = residuals.copy()
    starts(variance).free(left)
    samples = SECONDS / 0.1  # that are independent
    weight = np.sqrt(samples / ROWS / variance)
    for one, freed in zip(residuals, left, strict=True):
        for span in SPANS:
            columns = (STD[:, None] * RESPONSES[:, span, 0]).T
            matrix = np.vstack([weight * columns, np.eye(2)])
            target = np.concatenate([weight * one[span, 0], np.zeros(2)])
            x = np.linalg.lstsq(matrix, target, rcond=None)[0]
            np.testing.assert_allclose(freed[span, 0], one[span, 0] - columns @ x, atol=1e-9)


def test_linear_and_of_no_trials() -> None:
    residuals = np.random.default_rng(3).standard_normal((3, len(T), 1))
    residuals[2] = residuals[0] - 2 * residuals[1]
    residuals = np.concatenate([residuals, np.full((1, len(T), 1), np.nan)])
    starts(1e-4).free(residuals)
    np.testing.assert_allclose(residuals[2], residuals[0] - 2 * residuals[1], atol=1e-12)
    assert np.isfinite(residuals[:3]).all()
    none = np.zeros((0, len(T), 1))
    starts(1e-4).free(none)
    assert none.shape == (0, len(T), 1)


def logged(noise: float = 2e-4, damping: float | None = None) -> list[Recording]:
    """A leg under torques of a control loop of its own, by the model's own steps."""
    model = mujoco.MjModel.from_xml_string(LEG)
    if damping is not None:
        model.dof_damping[1] = damping
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 4.0, model.opt.timestep)
    recordings = []
    for name, pace in (("a", 3.0), ("b", 4.0), ("c", 5.0)):
        data = mujoco.MjData(model)
        q, effort = np.empty((len(time), 2)), np.empty((len(time), 2))
        for k, now in enumerate(time):
            target = np.array([0.6 * np.sin(pace * now), -0.8 + 0.5 * np.sin(1.3 * pace * now)])
            data.ctrl[:] = 60 * (target - data.qpos) - 2 * data.qvel
            q[k], effort[k] = data.qpos + noise * rng.standard_normal(2), data.ctrl
            mujoco.mj_step(model, data)
        columns = {}
        for j, joint in enumerate(("hip", "knee")):
            columns |= {f"{joint}/position": q[:, j], f"{joint}/effort_target": effort[:, j]}
        recordings.append(Recording(name=name, time=time, columns=columns))
    return recordings


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("leg") / "leg.xml"
    path.write_text(LEG)
    return str(path)


def nothing(objective: Objective) -> Case:
    robots = tuple(replay.robot for replay in objective.replays)
    return Case(structure=Structure((), robots), values=np.zeros((1, 0)))


def test_noise_is_all_that_is_left_of_a_leg_under_torque(leg: str) -> None:
    """Half a second makes ten times the noise of what the noise makes of a start."""
    half = steps.load(leg, logged()).fit
    case = nothing(half.objective)
    (raw,) = half.objective.simulated([case])
    half.objective.refine(half.finer, case)
    (left,) = half.objective.residuals([case])
    assert rms(raw) > 10 * 2e-4
    assert rms(left) < 1.2 * 2e-4


def test_what_is_missing_stays(leg: str) -> None:
    half = steps.load(leg, logged(damping=0.4)).fit
    case = nothing(half.objective)
    (raw,) = half.objective.simulated([case])
    half.objective.refine(half.finer, case)
    (left,) = half.objective.residuals([case])
    assert rms(raw) > 0.02
    assert rms(left) > 0.7 * rms(raw)


def test_values_are_known_as_well_as_the_positions_tell(leg: str) -> None:
    found = steps.fit(steps.load(leg, logged(damping=0.4)), {"viscous_friction": ["knee"]})
    (parameter,) = found.effects[0].parameters
    assert parameter.value == pytest.approx(0.35, abs=4e-4)
    assert abs(parameter.value - 0.35) < 4 * parameter.std


def test_a_trial_starts_off_by_standard_deviations_of_the_measured_state(leg: str) -> None:
    replay = steps.load(leg, logged()).fit.objective.replays[0]
    trials = Trials(replay.robot, 3)
    trials.start_errors["knee"][1, 0] = 5.0
    trials.start_errors["knee"][2, 1] = 5.0
    own, elsewhere, faster = replay.predict(trials)
    first = np.searchsorted(replay.segment_of_row, np.arange(len(replay.segments)))
    knee = [c.joint for c in replay.channels].index("knee")
    moved = elsewhere[first, knee] - own[first, knee]
    assert (moved > 5 * 1.5e-4).all()
    assert np.median(moved) < 5 * 3e-4
    np.testing.assert_array_equal(faster[first, knee], own[first, knee])
    assert (faster[first + 1, knee] > own[first + 1, knee]).all()
