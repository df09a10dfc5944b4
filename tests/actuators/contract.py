"""What every actuator has to do, as tests that any config can be put through.

class TestMine(DeterministicContract):
    words = ("position",)
    cfg = MyActuatorCfg(joint_names_expr=EXPRESSIONS, stiffness=30.0)

    def expected(self, j, history, q, qd):
        p, _, _ = history[-1]
        return 30.0 * (p - q), 30.0 * (p - q)
"""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import composer, mjcf

from tests.actuators.reference import clip
from tests.actuators.robots import (
    EXPRESSIONS,
    JOINTS,
    TIMESTEP,
    WORDS,
    Arena,
    Task,
    Walker,
    batch_of,
    built,
    changed,
    commands,
    compiled,
    place,
    robot,
    run,
)
from walkerkit.actuators import ActuatorCmd, ActuatorGroup

__all__ = ["EXPRESSIONS", "ActuatorContract", "DeterministicContract", "clip"]

N_STEPS = 24
N_SIMS = 3


class ActuatorContract:
    """Promises that hold for random lags, too.

    Attributes:
        cfg: the config, of the joints `hip`, `knee` and `rail` unless `joints` says otherwise.
        words: the targets that it is given.
        scale: of the targets, large enough to meet the limits.
        actuator: XML of actuators that the robot has already.
        limits: the most effort of each joint; None where there is no limit.
        of_joints: it drives joints, and not tendons or sites.
    """

    cfg = None
    joints = JOINTS
    words = ("position",)
    scale = 0.4
    actuator = ""
    limits = None
    of_joints = True

    def built(self):
        return built(self.cfg, robot(self.actuator))

    def script(self, shape, seed=0, n_steps=N_STEPS):
        return commands(n_steps, shape, self.words, seed=seed, scale=self.scale)

    @property
    def n(self):
        return len(self.joints)

    def batch(self):
        actuator, physics = self.built()
        batch = batch_of(physics, N_SIMS)
        actuator.initialize(batch)
        actuator.reset()
        return actuator, batch

    # Where it works.

    def test_names_ids_and_places(self):
        actuator, physics = self.built()
        model = physics.model.ptr
        assert actuator.joint_names == self.joints
        assert (np.diff(actuator.joint_ids) > 0).all()
        if self.of_joints:
            names = [model.joint(i).name for i in actuator.joint_ids]
            assert names == [f"robot/{name}" for name in self.joints]
        for element, place_ in zip(actuator.elements, actuator.ctrl_ids, strict=True):
            assert place_ == model.actuator_ctrladr[model.actuator(element.full_identifier).id]
            assert element.name in {*self.joints, *(f"{name}_actuator" for name in self.joints)}
        assert 0 not in actuator.ctrl_ids  # that is the spare motor's

    @pytest.mark.parametrize("n_sims", [None, 1, N_SIMS])
    def test_shapes(self, n_sims):
        actuator, physics = self.built()
        shape = (self.n,)
        if n_sims is not None:
            physics = batch_of(physics, n_sims)
            actuator.initialize(physics)
            actuator.reset()
            shape = (n_sims, self.n)
        for cmd in self.script(shape, n_steps=3):
            for array in (actuator.compute(cmd), actuator.computed_effort, actuator.applied_effort):
                assert array.shape == shape
                assert np.isfinite(array).all()
        for name in actuator.parameters:
            assert actuator.nominal(name).shape == (self.n,)
            assert actuator.get(name).shape == shape

    def test_what_it_gives_is_not_written_to_later(self):
        actuator, _ = self.built()
        first = {f"{word}_target": np.full(self.n, 0.1) for word in self.words}
        controls = actuator.compute(ActuatorCmd(**first))
        kept = controls.copy()
        actuator.compute(ActuatorCmd(**{name: 3 * value for name, value in first.items()}))
        np.testing.assert_array_equal(controls, kept)
        efforts = actuator.computed_effort
        efforts[:] = np.nan
        assert np.isfinite(actuator.computed_effort).all()

    # Order of calls.

    def test_calls_out_of_order_are_refused(self):
        root = robot(self.actuator)
        actuator = self.cfg.build()
        other = mjcf.Physics.from_mjcf_model(mjcf.RootElement(model="empty"))
        with pytest.raises(RuntimeError, match=r"call edit_mjcf\(root\) before"):
            actuator.initialize(other)
        actuator.edit_mjcf(root)
        with pytest.raises(RuntimeError, match=r"initialize\(physics\)"):
            actuator.reset()
        with pytest.raises(RuntimeError, match=r"initialize\(physics\)"):
            actuator.compute(self.script((self.n,))[0])
        with pytest.raises(ValueError, match="the compiled model has no"):
            actuator.initialize(other)

    def test_update_takes_the_models_timestep_only(self):
        actuator, _ = self.built()
        actuator.update(TIMESTEP)
        for dt in (0.004, 0.001, 0.0):
            with pytest.raises(ValueError, match=f"dt is {dt} s, the model's timestep 0.002 s"):
                actuator.update(dt)

    # Commands.

    def test_wrong_commands_are_refused(self):
        actuator, _ = self.built()
        word = self.words[0]
        for shape in ((self.n + 1,), (1, self.n), (N_SIMS, self.n)):
            with pytest.raises(ValueError) as error:
                actuator.compute(ActuatorCmd(**{f"{word}_target": np.zeros(shape)}))
            for part in (f"{word}_target", str(shape), str((self.n,)), self.joints[0]):
                assert part in str(error.value)
        with pytest.raises(TypeError, match="takes an ActuatorCmd"):
            actuator.compute(np.zeros(self.n))

    def test_targets_that_it_needs_or_cannot_follow(self):
        actuator, _ = self.built()
        full = {f"{word}_target": np.ones(self.n) for word in WORDS}
        for name in actuator.needs:
            rest = {key: value for key, value in full.items() if key in actuator.takes - {name}}
            with pytest.raises(ValueError, match=f"needs a {name}"):
                actuator.compute(ActuatorCmd(**rest))
        taken = {key: value for key, value in full.items() if key in actuator.takes}
        actuator.compute(ActuatorCmd(**taken))
        for name in full.keys() - actuator.takes:
            with pytest.raises(ValueError, match=f"cannot follow a {name}"):
                actuator.compute(ActuatorCmd(**taken, **{name: np.ones(self.n)}))
            actuator.compute(ActuatorCmd(**taken, **{name: np.zeros(self.n)}))

    # Efforts.

    def test_applied_effort_is_within_limits_and_what_mujoco_exerts(self):
        actuator, physics = self.built()
        record = run(actuator, physics, self.script((self.n,)))
        if self.limits is None:
            np.testing.assert_array_equal(record.applied, record.computed)
        else:
            limits = np.array(self.limits)
            assert (np.abs(record.applied) <= limits).all()
            assert (np.abs(record.computed) > limits).any()
            assert (np.abs(record.applied) < limits).any()
        if self.of_joints:
            dofs = physics.model.ptr.jnt_dofadr[actuator.joint_ids]
            np.testing.assert_allclose(
                record.exerted[:, dofs], record.applied, rtol=1e-12, atol=1e-12
            )

    # Resets.

    def test_partial_reset_leaves_the_other_rows_alone(self):
        script = self.script((N_SIMS, self.n))
        records = []
        for rows in ([], [1]):
            actuator, batch = self.batch()

            def reset(k, rows=rows, actuator=actuator, batch=batch):
                if k == 10 and rows:
                    place(batch, rows)
                    actuator.reset(rows)

            records.append(run(actuator, batch, script, reset))
        untouched, partly = records
        for row in (0, 2):
            assert untouched.row(row) == partly.row(row)
        assert untouched.row(1) != partly.row(1)

    def test_partial_reset_keeps_the_efforts_of_the_other_rows(self):
        actuator, batch = self.batch()
        run(actuator, batch, self.script((N_SIMS, self.n), n_steps=5))
        before = actuator.computed_effort, actuator.applied_effort
        actuator.reset([1])
        for old, new in zip(
            before, (actuator.computed_effort, actuator.applied_effort), strict=True
        ):
            np.testing.assert_array_equal(old[[0, 2]], new[[0, 2]])

    def test_ids_of_a_reset(self):
        actuator, physics = self.built()
        with pytest.raises(ValueError, match=r"env_ids=\[0\]: there is one physics"):
            actuator.reset([0])
        actuator.initialize(batch_of(physics, N_SIMS))
        for wrong in ([3], [-1], [0.5], [[0]], [True, False]):
            with pytest.raises(
                ValueError, match="env_ids should be ids from 0 to 2, or a mask of 3"
            ):
                actuator.reset(wrong)
        for right in ([], 2, [0, 2], np.array([1]), np.array([False, True, True]), None):
            actuator.reset(right)

    # Parameters.

    def test_parameters_of_some_rows(self):
        actuator, _ = self.batch()
        for name in set(actuator.parameters) - {"delay_min_lag", "delay_max_lag"}:
            nominal = actuator.nominal(name)
            np.testing.assert_array_equal(actuator.get(name), np.tile(nominal, (N_SIMS, 1)))
            actuator.set(name, 1.5 * nominal + 0.01, [2])
            np.testing.assert_array_equal(actuator.get(name)[:2], np.tile(nominal, (2, 1)))
            np.testing.assert_allclose(actuator.get(name)[2], 1.5 * nominal + 0.01, rtol=1e-14)
            np.testing.assert_array_equal(actuator.nominal(name), nominal)

    def test_changed_parameters_work_and_end_with_the_next_initialize(self):
        script = self.script((N_SIMS, self.n))
        actuator, batch = self.batch()
        plain = run(actuator, batch, script)
        actuator, batch = self.batch()
        for name in ("strength", *({"armature"} & {*actuator.parameters})):
            actuator.set(name, 0.5 * actuator.nominal(name) + 0.01, [1])
        other = run(actuator, batch, script)
        assert other.row(0) == plain.row(0)
        assert not np.array_equal(other.row(1).qpos, plain.row(1).qpos)
        for name in actuator.parameters:
            if name not in ("delay_min_lag", "delay_max_lag"):
                actuator.set(name, 0.7 * actuator.nominal(name))
        place(batch)
        actuator.initialize(batch)
        actuator.reset()
        for name in actuator.parameters:
            np.testing.assert_array_equal(
                actuator.get(name), np.tile(actuator.nominal(name), (N_SIMS, 1))
            )

    def test_unknown_parameter(self):
        actuator, _ = self.built()
        for call in (
            lambda: actuator.nominal("strenght"),
            lambda: actuator.get("strenght"),
            lambda: actuator.set("strenght", 1.0),
        ):
            with pytest.raises(KeyError, match="did you mean 'strength'"):
                call()


class DeterministicContract(ActuatorContract):
    """Promises of actuators that do the same thing again."""

    def expected(self, j, history, q, qd):
        """Effort of joint j before and after the limits, from plain numbers.

        `history` has (position, velocity, effort) of every command so far, None where not given.
        """
        raise NotImplementedError

    def measured(self, physics, actuator):
        """Position and velocity of what it drives, (..., n) each."""
        model = actuator.simulation.model
        data = getattr(physics, "data", physics)
        joints = actuator.joint_ids
        return data.qpos[..., model.jnt_qposadr[joints]], data.qvel[..., model.jnt_dofadr[joints]]

    @pytest.mark.parametrize("n_sims", [None, N_SIMS])
    def test_efforts_are_those_of_the_scalar_reference(self, n_sims):
        actuator, physics = self.built() if n_sims is None else self.batch()
        shape = (self.n,) if n_sims is None else (n_sims, self.n)
        script = self.script(shape)
        states = []

        def look(k):
            states.append(tuple(np.array(a) for a in self.measured(physics, actuator)))

        record = run(actuator, physics, script, look)
        for index in np.ndindex(shape):
            history = []
            for k, (q, qd) in enumerate(states):
                targets = [getattr(script[k], f"{word}_target") for word in WORDS]
                history.append(tuple(None if t is None else float(t[index]) for t in targets))
                computed, applied = self.expected(
                    index[-1], history, float(q[index]), float(qd[index])
                )
                assert record.computed[k][index] == pytest.approx(computed, rel=1e-12, abs=1e-12)
                assert record.applied[k][index] == pytest.approx(applied, rel=1e-12, abs=1e-12)

    def test_batch_is_bit_for_bit_what_each_physics_does(self):
        actuator, batch = self.batch()
        script = self.script((N_SIMS, self.n))
        together = run(actuator, batch, script)
        for row in range(N_SIMS):
            actuator, physics = self.built()
            alone = [changed(cmd, lambda target, row=row: target[row]) for cmd in script]
            assert run(actuator, physics, alone) == together.row(row)

    def test_composer_is_bit_for_bit_what_the_batch_does(self):
        root = robot(self.actuator)
        group = ActuatorGroup((self.cfg,))
        group.edit_mjcf(root)
        script = self.script((self.n,))
        walker = Walker(root, group, script)
        task = Task(Arena(walker))
        task.set_timesteps(control_timestep=4 * TIMESTEP, physics_timestep=TIMESTEP)
        environment = composer.Environment(task, random_state=0)
        for _ in range(2):  # the second episode after a recompilation
            environment.reset()
            for _ in range(len(script) // 4):
                environment.step(np.zeros(environment.action_spec().shape))
            inside = np.array(walker.qpos)
            batch = batch_of(environment.physics, 2)
            group.initialize(batch)
            group.reset()
            both = [changed(cmd, lambda target: np.stack([target, target])) for cmd in script]
            record = run(group, batch, both)
            np.testing.assert_array_equal(record.row(1).qpos, inside)

    def test_resets_forget_everything(self):
        script = self.script((self.n,))
        actuator, physics = self.built()
        first = run(actuator, physics, script)
        place(physics)
        actuator.reset()
        assert run(actuator, physics, script) == first
        run(actuator, physics, self.script((self.n,), seed=1))
        place(physics)
        actuator.reset()
        actuator.reset()
        assert run(actuator, physics, script) == first

    def test_a_reset_row_starts_like_a_new_one(self):
        actuator, batch = self.batch()
        script = self.script((N_SIMS, self.n))
        fresh = run(actuator, batch, script[10:])
        actuator, batch = self.batch()

        def reset(k):
            if k == 10:
                place(batch, [1])
                actuator.reset(np.array([False, True, False]))

        later = run(actuator, batch, script, reset)
        assert later.row(1).part(slice(10, None)) == fresh.row(1)

    def test_initialize_again(self):
        root = robot(self.actuator)
        script = self.script((self.n,))
        actuator, physics = built(self.cfg, root)
        first = run(actuator, physics, script)
        for again in (physics, compiled(root)):
            place(again)
            actuator.initialize(again)
            actuator.reset()
            assert run(actuator, again, script) == first

    def test_one_command_object_is_like_many_equal_ones(self):
        cmd = self.script((self.n,))[0]
        actuator, physics = self.built()
        same = run(actuator, physics, [cmd] * N_STEPS)
        actuator, physics = self.built()
        assert run(actuator, physics, [changed(cmd, np.copy) for _ in range(N_STEPS)]) == same
