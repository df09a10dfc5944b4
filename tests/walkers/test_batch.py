"""The lock-step engine against a plain loop over `mj_step`, and what it does when some fail."""

import mujoco
import numpy as np
import pytest

from walkerkit.walkers.batch import LockStep, counted_warnings

RIG = """
<mujoco><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="a" axis="0 1 0" damping="0.1" frictionloss="0.2"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
  <body name="tip" pos="0 0 -0.3"><joint name="b" axis="0 1 0" armature="0.01"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></body></worldbody>
<actuator><position joint="a" kp="30" kv="1"/><motor joint="b" gear="2"/></actuator></mujoco>
"""
STEPS = 150
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(RIG)


def states(model, qpos):
    rows = []
    for q in qpos:
        data = mujoco.MjData(model)
        data.qpos[:] = q
        rows.append(np.empty(mujoco.mj_stateSize(model, INTEGRATION)))
        mujoco.mj_getState(model, data, rows[-1], INTEGRATION)
    return np.stack(rows)


def commands(n):
    rng = np.random.default_rng(0)
    return 0.4 * np.cumsum(rng.normal(size=(n, STEPS, 2)), axis=1) / np.sqrt(STEPS)


def loop(model, qpos, ctrl, applied=None):
    """Positions, velocities and drive efforts of one simulation, stepped one by one."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    rows = []
    for k, row in enumerate(ctrl):
        data.ctrl[:] = row
        if applied is not None:
            data.qfrc_applied[:] = applied[k]
        mujoco.mj_step(model, data)
        rows.append([data.qpos.copy(), data.qvel.copy(), data.qfrc_actuator.copy()])
    return np.array(rows).transpose(1, 0, 2)


STARTS = np.array([[0.0, 0.0], [0.5, -0.3], [-1.0, 0.2]])
RECORD = ("qpos", "qvel", "qfrc_actuator")


def test_each_simulation_is_a_loop_of_steps(model):
    ctrl = commands(3)
    applied = np.random.default_rng(1).normal(size=(3, STEPS, 2))
    rollout = LockStep(model, 3, n_threads=1).rollout(
        states(model, STARTS), ctrl=ctrl, qfrc_applied=applied, record=RECORD
    )
    assert not rollout.failed.any()
    for i in range(3):
        expected = loop(model, STARTS[i], ctrl[i], applied[i])
        for name, values in zip(RECORD, expected, strict=True):
            np.testing.assert_array_equal(rollout.records[name][i], values)


def test_each_simulation_has_its_own_model_fields(model):
    ctrl, tips = commands(3), np.array([0.1, 0.4, 2.0])
    masses = np.tile(model.body_mass, (3, 1))
    masses[:, model.body("tip").id] = tips
    gravity = np.array([[0, 0, -9.81], [0, 0, 0], [3, 0, -9]])
    rollout = LockStep(
        model, 3, fields={"body_mass": masses, "opt.gravity": gravity}, n_threads=1
    ).rollout(states(model, STARTS), ctrl=ctrl)
    for i in range(3):
        other = mujoco.MjModel.from_xml_string(RIG)
        other.body("tip").mass = tips[i]
        other.opt.gravity = gravity[i]
        mujoco.mj_setConst(other, mujoco.MjData(other))
        expected = loop(other, STARTS[i], ctrl[i])[0]
        np.testing.assert_array_equal(rollout.records["qpos"][i], expected)
    assert model.body("tip").mass == pytest.approx(0.4)
    np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9.81])


TOUCHING = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1" contype="{floor}" conaffinity="{affinity}"/>
    <body pos="0 0 0.2"> <freejoint/>
      <geom size="0.1" contype="0" conaffinity="1"/> <site name="ball"/>
    </body>
  </worldbody>
  <sensor> <accelerometer site="ball"/> </sensor>
</mujoco>
"""


@pytest.mark.parametrize(("floor", "affinity"), [(1, 0), (0, 1), (2, 2)])
@pytest.mark.parametrize("record", [("qpos",), ("qpos", "sensordata")])
def test_what_may_touch_does_and_what_is_recorded_is_sensed(floor, affinity, record):
    model = mujoco.MjModel.from_xml_string(TOUCHING.format(floor=floor, affinity=affinity))
    data, own = mujoco.MjData(model), {name: [] for name in record}
    engine = LockStep(model, 1, n_threads=1)
    start = engine.batch.state.copy()
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        for name in record:
            own[name].append(getattr(data, name).copy())
    assert (data.qpos[2] < 0.05) == (floor != 1)
    runs = (
        engine.rollout(start, ctrl=np.zeros((1, STEPS, 0)), record=record),
        engine.step_by_step(start, STEPS, lambda _: None, record=record),
    )
    for rollout in runs:
        for name in record:
            np.testing.assert_array_equal(rollout.records[name][0], own[name])


def test_threads_change_nothing(model):
    ctrl, start = commands(3), states(model, STARTS)
    runs = [LockStep(model, 3, n_threads=n).rollout(start, ctrl=ctrl) for n in (1, 2)]
    np.testing.assert_array_equal(runs[0].records["qpos"], runs[1].records["qpos"])


def test_two_rollouts_of_one_engine_are_alike(model):
    engine, ctrl, start = LockStep(model, 3), commands(3), states(model, STARTS)
    first, second = (engine.rollout(start, ctrl=ctrl).records["qpos"] for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("value", [1e12, np.nan], ids=["unstable", "NaN"])
def test_one_that_diverges_is_nan_and_leaves_the_others_alone(
    model, value, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    ctrl, start = commands(3), states(model, STARTS)
    gain = np.tile(model.actuator_biasprm, (3, 1, 1))
    gain[1, 0, 2] = value
    engine = LockStep(model, 3, fields={"actuator_biasprm": gain})
    handler = mujoco.get_mju_user_warning()
    rollout = engine.rollout(start, ctrl=ctrl)
    np.testing.assert_array_equal(rollout.failed, [False, True, False])
    assert np.isnan(rollout.records["qpos"][1]).all()
    for i in (0, 2):
        np.testing.assert_array_equal(
            rollout.records["qpos"][i], loop(model, STARTS[i], ctrl[i])[0]
        )
    # The failure of one rollout is not held against the next.
    start[1] = start[0]
    assert engine.rollout(start, ctrl=0 * ctrl, record=("qvel",)).failed[1]
    assert mujoco.get_mju_user_warning() is handler
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_the_clock_is_read_by_whoever_else_steps_only(model):
    read = []

    def clock():
        read.append(None)
        return float(len(read))

    engine, ctrl, start = LockStep(model, 3), commands(3), states(model, STARTS)
    expected = engine.rollout(start, ctrl=ctrl).records["qpos"]
    mujoco.set_mjcb_time(clock)
    try:
        found = engine.rollout(start, ctrl=ctrl).records["qpos"]
        engine.step_by_step(start, 5, lambda k: None)
        engine.advance(5, lambda k: None)
        assert not read
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        assert read
        assert data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration > 0
    finally:
        mujoco.set_mjcb_time(None)
    np.testing.assert_array_equal(found, expected)


def test_one_that_diverged_can_run_again(model):
    ctrl, start = commands(2), states(model, STARTS[:2])
    engine = LockStep(model, 2)
    wild = start.copy()
    wild[1, 1] = 1e12  # of qpos, right after the time
    assert engine.rollout(wild, ctrl=ctrl).failed[1]
    again = engine.rollout(start, ctrl=ctrl)
    assert not again.failed.any()
    np.testing.assert_array_equal(again.records["qpos"][1], loop(model, STARTS[1], ctrl[1])[0])


def test_one_in_which_mujoco_raises_is_nan_and_leaves_the_others_alone(
    model, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    integrator = np.array([model.opt.integrator, 99, model.opt.integrator])
    ctrl = commands(3)
    rollout = LockStep(model, 3, fields={"opt.integrator": integrator}).rollout(
        states(model, STARTS), ctrl=ctrl
    )
    np.testing.assert_array_equal(rollout.failed, [False, True, False])
    assert np.isnan(rollout.records["qpos"][1]).all()
    np.testing.assert_array_equal(rollout.records["qpos"][2], loop(model, STARTS[2], ctrl[2])[0])
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


class TestLengths:
    """What a simulation does after the steps that count of it does not count."""

    @pytest.fixture(params=["rollout", "step_by_step"])
    def run(self, request, model):
        def run(ctrl, lengths=None):
            engine, start = LockStep(model, len(ctrl)), states(model, STARTS[: len(ctrl)])
            if request.param == "rollout":
                return engine.rollout(start, ctrl=ctrl, record=RECORD, lengths=lengths)

            def before(k):
                engine.live("ctrl")[...] = ctrl[:, k]

            return engine.step_by_step(start, ctrl.shape[1], before, record=RECORD, lengths=lengths)

        return run

    def wild(self, *at):
        """Controls that go out of hand at a step each."""
        ctrl = commands(len(at))
        for one, k in zip(ctrl, at, strict=True):
            one[k:] = 1e14
        return ctrl

    def test_each_is_what_it_is_alone(self, run):
        ctrl, lengths = commands(3), np.array([STEPS, 100, 63])
        found = run(ctrl, lengths)
        assert not found.failed.any()
        for k, length in enumerate(lengths):
            alone = run(ctrl[:, :length])
            for name in RECORD:
                np.testing.assert_array_equal(
                    found.records[name][k, :length], alone.records[name][k]
                )

    def test_one_that_diverges_after_its_end_has_not_failed(self, run):
        ctrl = self.wild(101, 40, STEPS)
        with counted_warnings() as counted:
            found = run(ctrl, np.array([100, 100, STEPS]))
        np.testing.assert_array_equal(found.failed, [False, True, False])
        assert counted == {"bad control": 1} or counted == {"bad acceleration": 1}
        alone = run(ctrl[:, :100])
        for name in RECORD:
            np.testing.assert_array_equal(found.records[name][0, :100], alone.records[name][0])
        with counted_warnings() as counted:
            assert run(ctrl).failed.tolist() == [True, True, False]
        assert sum(counted.values()) == 2


@pytest.mark.parametrize("fields", [{"dof_damping"}, {"body_mass", "dof_damping"}, {"opt.gravity"}])
def test_what_all_have_is_as_what_each_has(model, fields):
    values = {
        "dof_damping": np.tile([0.3, 0.2], (2, 1)),
        "body_mass": np.tile([0.0, 1.3, 0.5], (2, 1)),
        "opt.gravity": np.tile([0.0, 1.0, -9.0], (2, 1)),
    }
    given = {name: values[name] for name in fields}
    before = {name: np.array(getattr(model, name)) for name in ("dof_damping", "body_mass")}
    # A third that has others makes each have its own.
    mixed = {name: np.concatenate([own, 1.1 * own[:1]]) for name, own in given.items()}
    ctrl, start = commands(3), states(model, STARTS)
    shared = LockStep(model, 2, fields=given)
    own = LockStep(model, 3, fields=mixed)
    found = shared.rollout(start[:2], ctrl=ctrl[:2], record=RECORD).records
    expected = own.rollout(start, ctrl=ctrl, record=RECORD).records
    alone = LockStep(model, 2).rollout(start[:2], ctrl=ctrl[:2], record=RECORD).records
    for name in RECORD:
        np.testing.assert_array_equal(found[name], expected[name][:2])
        assert not np.array_equal(found[name], alone[name])
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(model, name), value)
    derived = [engine.batch.get_model(0).dof_invweight0 for engine in (shared, own)]
    np.testing.assert_array_equal(*derived)
