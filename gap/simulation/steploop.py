"""Simulations in lock step with laws that MuJoCo does not have, run before each of their steps.

The model's own drives still make the effort, so that MuJoCo integrates their damping as it always
does; what the laws change of it is applied to the joint beside them. A drive whose own law runs in
Python makes what that says, as in a walker. What the laws remember of the time before the first
step comes from what was measured then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import IntegralAction, LawBank
from walkerkit.gap.simulation.drive_forces import adjoining
from walkerkit.gap.simulation.law_memory import Past
from walkerkit.gap.simulation.laws import Laws
from walkerkit.gap.simulation.programs_at_work import RunningPrograms
from walkerkit.gap.simulation.robot import Joint
from walkerkit.walkers.batch import LockStep, Rollout

FloatArray = NDArray[np.float64]


def rollout_with_laws(
    batch: LockStep,
    state: FloatArray,
    *,
    laws: Laws,
    ctrl: FloatArray,
    qfrc_applied: FloatArray | None,
    record: Sequence[str],
    time: FloatArray,
    ahead: FloatArray | None = None,
    voltage: FloatArray | None = None,
    past: Past | None = None,
    lengths: NDArray[np.intp] | None = None,
) -> tuple[Rollout, FloatArray | None]:
    """As `LockStep.rollout`, with laws before each step.

    Args:
        batch: the simulations.
        state: (n_sims, nstate) where they start.
        laws: the laws, of which those that are run step by step act.
        ctrl: (n_sims, n_steps, width) controls as the drives receive them.
        qfrc_applied: (n_sims, n_steps, nv) effort applied beside them, or None.
        record: fields to keep after every step.
        time: (n_sims,) of the first step, by the robot's clock [s].
        ahead: (n_sims, n_steps, n_joints) what targets are at the steps' beginnings over what
            `ctrl` says; None where they are the same.
        voltage: (n_sims, n_steps, 1) of the supply, NaN where it is not known [V]; None where it
            never is.
        past: what the laws saw before it; None for nothing.
        lengths: (n_sims,) the steps that count of each; None for all.

    Returns:
        What was recorded, and (n_sims, n_steps, n_joints) what the laws changed of the effort that
        the drives report at the steps' beginnings, or None where they do not touch it.
    """
    bank = laws.bank()
    loop = _Loop(laws, bank, batch.model)
    changed = None
    if ahead is not None or bank.has("controller") or bank.has("drive"):
        changed = np.zeros((ctrl.shape[1], ctrl.shape[0], len(laws.joints)))
    before = _before_each(batch, loop, laws, bank, ctrl, qfrc_applied, changed)
    # A variant that is about to diverge is not worth a warning.
    with np.errstate(all="ignore"):
        if past is not None:
            loop.see(past, time, voltage)
        loop.begin(ctrl, time, ahead, voltage)
        rollout = batch.step_by_step(state, ctrl.shape[1], before, record=record, lengths=lengths)
    return rollout, None if changed is None else changed.swapaxes(0, 1)


def _before_each(
    batch: LockStep,
    loop: _Loop,
    laws: Laws,
    bank: LawBank,
    ctrl: FloatArray,
    qfrc_applied: FloatArray | None,
    changed: FloatArray | None,
) -> Callable[[int], None]:
    """What is called before each step: it runs the laws and writes what they say to the batch.

    What they change of efforts goes to `changed`, (n_steps, n_sims, n_joints), unless it is None.
    """
    live_qpos, live_qvel = batch.live("qpos"), batch.live("qvel")
    live_ctrl, live_applied = batch.live("ctrl"), batch.live("qfrc_applied")
    dofs = adjoining([joint.dof for joint in laws.joints])
    q, qd = _state(live_qpos, live_qvel, laws.joints)
    own = None if laws.programs is None else _state(live_qpos, live_qvel, laws.programs.joints)
    applied = _Columns(live_applied, dofs)
    (mine, native), nu = laws.forces.native, batch.model.nu
    act = None if laws.forces.filters is None else batch.live("act")
    held = _Columns(batch.derived("qfrc_constraint"), dofs) if bank.reads_held else None
    plays = []
    if bank.reads_play:
        plays = [(k, one.play) for k, one in enumerate(laws.joints) if one.play is not None]
        loop.step.play, loop.step.play_speed = np.zeros((2, *laws.shape))
    rubbing, rubbed = bank.has("joint"), False
    if rubbing:
        dry = _Columns(batch.parameter("dof_frictionloss"), dofs)
        loop.step.dry = own_dry = dry.now().copy()

    def before(k: int) -> None:
        nonlocal rubbed
        if held is not None:
            loop.step.held = held.now()
        for column, play in plays:
            loop.step.play[:, column] = live_qpos[:, play.qpos]
            loop.step.play_speed[:, column] = live_qvel[:, play.dof]
        loop.run(k, q.now(), qd.now(), act, own and (own[0].now(), own[1].now()))
        live_ctrl[...] = ctrl[:, k, :nu]
        if loop.control is not None:
            live_ctrl[:, native] = loop.control[:, mine]
        if laws.programs is not None:
            live_ctrl[:, laws.programs.motors] = loop.made
        beside = loop.changed + loop.step.extra
        if qfrc_applied is not None:
            live_applied[...] = qfrc_applied[:, k]
            beside += applied.now()
        applied.put(beside)
        if changed is not None:
            np.add(loop.changed, loop.step.effort_ahead, out=changed[k])
        if rubbing:
            friction = loop.step.friction
            if rubbed or friction.any():
                dry.put(np.maximum(own_dry + friction, 0.0))
                rubbed = True

    return before


def _state(
    qpos: FloatArray, qvel: FloatArray, joints: Sequence[Joint]
) -> tuple[_Columns, _Columns]:
    """The columns of some joints' positions and velocities."""
    return (
        _Columns(qpos, adjoining([joint.qpos for joint in joints])),
        _Columns(qvel, adjoining([joint.dof for joint in joints])),
    )


class _Columns:
    """Columns of an array that is written to again and again."""

    def __init__(self, live: FloatArray, columns: slice | NDArray[np.intp]):
        self._live, self._columns = live, columns
        self._view = live[:, columns] if isinstance(columns, slice) else None

    def now(self) -> FloatArray:
        """As they are now: the same view every time, where it can be one."""
        return self._live[:, self._columns] if self._view is None else self._view

    def put(self, values: FloatArray) -> None:
        """Writes to them."""
        if self._view is None:
            self._live[:, self._columns] = values
        else:
            self._view[...] = values


class _Loop:
    """The laws of one step after the other.

    Attributes:
        step: the step as the laws left it.
        control: (n_sims, n_drives) controls that the laws moved, or None where none does.
        made: (n_sims, n) what the laws of drives in Python send to their motors.
        changed: (n_sims, n_joints) what they changed of the effort that the drives report.
    """

    def __init__(self, laws: Laws, bank: LawBank, model: mujoco.MjModel):
        self._forces, self._bank = laws.forces, bank
        self._controlling, self._driving, self._rubbing = (
            bank.has(stage) for stage in ("controller", "drive", "joint")
        )
        self.step = laws.step()
        self.control: FloatArray | None = None
        self.changed = self.step.effort
        self._times = self.step.time
        self._controls = self._targets = self._asked = self._zeros = self.step.effort
        self._ahead: FloatArray | None = None
        self._voltage: FloatArray | None = None
        self._programs = None if laws.programs is None else laws.programs.start(model)
        self.made = self._all = self.step.effort
        self._places: dict[int, int] = {}
        if laws.programs is not None:
            measured = {joint.name: k for k, joint in enumerate(laws.joints)}
            of = laws.programs.joints
            self._places = {k: measured[j.name] for k, j in enumerate(of) if j.name in measured}

    def begin(
        self,
        ctrl: FloatArray,
        time: FloatArray,
        ahead: FloatArray | None = None,
        voltage: FloatArray | None = None,
    ) -> None:
        """Takes up the controls of the steps that follow, (n_sims, n_steps, nu), from a time on."""
        self._ahead, self._voltage = ahead, voltage
        steps = np.arange(ctrl.shape[1])
        self._times = time[:, None] + (steps * self.step.dt)[:, None, None]
        self._controls = np.ascontiguousarray(ctrl[..., self._forces.ctrl].swapaxes(0, 1))
        self._targets = self._forces.targets(self._controls)
        self._asked = self._forces.asked(self._controls)
        self._all = ctrl
        if self._programs is not None:
            self._programs.begin()

    def run(
        self,
        k: int,
        q: FloatArray,
        qd: FloatArray,
        act: FloatArray | None,
        own: tuple[FloatArray, FloatArray] | None,
    ) -> None:
        """Runs the laws for step k, (n_sims, ...) arrays each; `own` of joints with programs."""
        made = self._driven(k, q, qd, act, own)
        if self._rubbing:
            self.step.extra.fill(0.0)
            self.step.friction.fill(0.0)
            self._bank.run("joint", self.step)
        if self._driving:
            self.changed = self.step.effort - made

    def see(self, past: Past, time: FloatArray, voltage: FloatArray | None) -> None:
        """Lets the laws of controller and drive see what was before the first step, at `time`."""
        n_steps = past.ctrl.shape[1]
        before_it = None if voltage is None else voltage[:, :1]
        self.begin(past.ctrl, time - self.step.dt * n_steps, voltage=before_it)
        for k in range(n_steps):
            self._warm(k, past.q[:, k], past.qd[:, k])
            self._forget(past.unknown[:, k])
        if past.integral is not None:
            self._bank.remember(IntegralAction, {"effort": past.integral})

    def _warm(self, k: int, q: FloatArray, qd: FloatArray) -> None:
        """Lets the laws of controller and drive see a step of the past."""
        own = None
        if self._programs is not None:
            own = self._programs.at_rest_but(q, qd, self._places)
        self._driven(k, q, qd, None, own)

    def _forget(self, rows: NDArray[np.bool_]) -> None:
        """Resets laws of drives in some simulations, of which nothing is known so far."""
        if self._programs is not None and rows.any():
            self._programs.forget(np.flatnonzero(rows))

    def _driven(
        self,
        k: int,
        q: FloatArray,
        qd: FloatArray,
        act: FloatArray | None,
        own: tuple[FloatArray, FloatArray] | None,
    ) -> FloatArray:
        """Runs controller and drive; returns the effort made without laws of the drive."""
        step, forces = self.step, self._forces
        step.time = self._times[k]
        step.q, step.qd = q, qd
        if self._voltage is not None:
            step.voltage = self._voltage[:, min(k, self._voltage.shape[1] - 1)]
        step.target, asked = self._targets[k], self._asked[k]
        step.target_ahead = self._zeros if self._ahead is None else self._ahead[:, k]
        if self._controlling:
            self._bank.run("controller", step)
            self.control = forces.moved(self._controls[k], step.target - self._targets[k])
            asked = forces.asked(self.control, act)
        elif act is not None:
            asked = forces.asked(self._controls[k], act)
        made = step.effort = forces.effort(asked, q, qd)
        if self._programs is not None and own is not None:
            made = step.effort = self._with_programs(self._programs, k, made, own)
        step.effort_ahead = self._zeros
        if step.target_ahead is not self._zeros:
            control = self._controls[k] if self.control is None else self.control
            step.effort_ahead = forces.ahead(made, control, step.target_ahead)
        if self._driving:
            self._bank.run("drive", step)
        return made

    def _with_programs(
        self,
        programs: RunningPrograms,
        k: int,
        made: FloatArray,
        own: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """The efforts with those that laws of drives in Python make."""
        sent = self._all[:, k]
        if self.control is not None:
            sent = sent.copy()
            sent[:, self._forces.ctrl] = self.control
        self.made = programs.controls(sent, *own)
        mine, theirs = [*self._places], [*self._places.values()]
        made = made.copy()
        made[:, theirs] = programs.of.efforts(self.made)[:, mine]
        return made
