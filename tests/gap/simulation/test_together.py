"""Robots in one batch predict what each predicts alone, whatever differs between them."""

import numpy as np
import pytest

from tests.gap.simulation.arm import CHANNELS, arm
from walkerkit.actuators.drivetrain import LoopDelay
from walkerkit.actuators.drivetrain.controller import (
    IntegralAction,
    SampleAndHold,
    SetpointFilter,
)
from walkerkit.actuators.drivetrain.drive_stage import Cogging, SupplySag
from walkerkit.actuators.drivetrain.joint_friction import LoadDependentFriction
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation import together as module
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.replay import Replay, predict_together
from walkerkit.gap.simulation.together import Asked
from walkerkit.gap.simulation.trials import Trials


def replay(seed: int, n: int = 300, **changed: object) -> Replay:
    time = 0.002 * np.arange(n)
    phase = np.random.default_rng(seed).uniform(0, 6, 2)
    recording = Recording(
        name="log",
        time=time,
        columns={
            "hip/position": 0.1 + 0.3 * np.sin(5 * time + phase[0]),
            "knee/position": np.full(len(time), 0.4),
            "hip/position_target": 0.1 + 0.4 * np.sign(np.sin(5 * time + phase[0])),
            "knee/position_target": 0.4 + 0.35 * np.sin(7 * time + phase[1]),
        },
    )
    return Replay(arm(**changed), whole(recording), CHANNELS, n_threads=1)


def trials(one: Replay, law=None, **parameters: float) -> Trials:
    found = Trials(one.robot, 3)
    found.field("dof_damping")[:, 0] = [0.1, 0.2, 0.3]
    if law is not None:
        for name, value in parameters.items():
            found.law(law, "hip")[name][:] = [0.0, value, 2 * value]
    return found


@pytest.fixture
def batches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many simulations each batch had."""
    sizes: list[int] = []
    done = Asked.done

    def counted(self: Asked):
        sizes.append(self.n_sims)
        return done(self)

    monkeypatch.setattr(Asked, "done", counted)
    return sizes


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        (None, {}),
        (Cogging, {"amplitude": 0.3, "periods": 4.0}),
        (LoadDependentFriction, {"coefficient": 0.1}),
        (IntegralAction, {"gain": 20.0}),
        (SetpointFilter, {"time_constant": 0.02}),
    ],
)
def test_gain_load_and_gravity_make_one_batch(batches, law, parameters):
    replays = [replay(0), replay(1, n=280, kp=90), replay(2, mass=1.4, gravity=-9.7)]
    tried = [trials(one, law, **parameters) for one in replays]
    together = predict_together(replays, tried, 2)
    most = max(batches)
    assert most >= 6  # two variants of each robot at least
    for one, own, found in zip(replays, tried, together, strict=True):
        np.testing.assert_array_equal(found, one.predict(own))
        assert np.isfinite(found).all()
    assert max(batches) == most


@pytest.mark.parametrize(
    "changed",
    [
        {"integrator": "Euler"},
        {"step": 0.001},
        {"hip": 'ctrllimited="true" ctrlrange="-1 1"'},
        {"n": 200},
    ],
)
def test_others_run_beside_each_other(batches, changed):
    replays = [replay(0), replay(1, **changed)]
    tried = [trials(one, Cogging, amplitude=0.3, periods=4.0) for one in replays]
    together = predict_together(replays, tried, 2)
    assert max(batches) <= 3
    for one, own, found in zip(replays, tried, together, strict=True):
        np.testing.assert_array_equal(found, one.predict(own))


def test_controllers_of_several_robots_run_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []
    own = Laws.controlled

    def counted(self: Laws, ctrl, time):
        counts.append(len(ctrl))
        return own(self, ctrl, time)

    monkeypatch.setattr(Laws, "controlled", counted)
    replays = [replay(0), replay(1, n=280, kp=90), replay(2, n=60)]
    tried = [
        trials(replays[0], SetpointFilter, time_constant=0.02),
        trials(replays[1], SampleAndHold, period=0.013),
        trials(replays[2], SetpointFilter, time_constant=0.05),
    ]
    together = predict_together(replays, tried, 1)
    assert counts == [4, 2]  # the third is much shorter
    for one, variants, found in zip(replays, tried, together, strict=True):
        np.testing.assert_array_equal(found, one.predict(variants))


@pytest.mark.parametrize(
    "laws",
    [
        [(Cogging, {"amplitude": 0.3, "periods": 4.0})],
        [(IntegralAction, {"gain": 20.0}), (LoadDependentFriction, {"coefficient": 0.1})],
        # The drive's report is touched in some simulations only.
        [(LoopDelay, {"delay": 0.0034}), (SupplySag, {"sag": 0.05}), (Cogging, {"amplitude": 0.1})],
    ],
)
def test_processes_find_what_one_finds(monkeypatch: pytest.MonkeyPatch, laws) -> None:
    monkeypatch.setattr(module, "_WORTH_PROCESSES", 1)
    monkeypatch.setattr(module, "_FEWEST", 1)
    # Two make a rollout together, the third is too short for that.
    replays = [replay(0), replay(1, kp=90), replay(2, n=90)]
    tried = []
    for one in replays:
        found = Trials(one.robot, 2 * len(laws) + 1)
        found.field("dof_damping")[:, 0] = np.linspace(0.1, 0.3, found.n)
        for k, (law, parameters) in enumerate(laws):
            for name, value in parameters.items():
                found.law(law, "hip")[name][[k, k + len(laws)]] = [value, 2 * value]
        tried.append(found)
    shares: list[int] = []
    side_by_side = module.side_by_side

    def counted(function, jobs):
        shares.append(len(jobs))
        return side_by_side(function, jobs)

    monkeypatch.setattr(module, "side_by_side", counted)
    alone, *others = (predict_together(replays, tried, n) for n in (1, 2, 3))
    assert shares == [2, 3]
    for other in others:
        for one, found in zip(alone, other, strict=True):
            np.testing.assert_array_equal(found, one)
            assert np.isfinite(found).all()


@pytest.mark.parametrize("law", [None, Cogging])
def test_what_a_shorter_one_does_after_its_end_does_not_count(batches, law) -> None:
    longer, shorter, through = replay(0), replay(1, n=280), replay(1)
    tried = []
    for one in (longer, shorter, through):
        own = Trials(one.robot, 30)
        own.field("dof_damping")[:, 0] = -np.linspace(1.2, 1.6, own.n)  # which drives it away
        if law is not None:
            own.law(law, "hip")["amplitude"][:] = 0.3
            own.law(law, "hip")["periods"][:] = 4.0
        tried.append(own)
    found = predict_together([longer, shorter], tried[:2], 1)
    assert max(batches) == 60
    for one, own, predicted in zip((longer, shorter), tried[:2], found, strict=True):
        np.testing.assert_array_equal(predicted, one.predict(own))
    of_shorter, of_all = (
        np.isnan(some).any(axis=(1, 2)) for some in (found[1], through.predict(tried[2]))
    )
    assert 0 < of_shorter.sum() < of_all.sum() < 30
