"""A known structure, fitted: `gap.fit` beside `mujoco.sysid`, in seconds and in what is left.

    python -m benchmarks sysid_fit             # 3 and 12 joints, three logs of 10 s each
    python -m benchmarks sysid_fit --quick     # 3 joints, logs of 3 s

A robot of MuJoCo itself has other armature, damping and frictionloss than its model, at each of its
joints. Its logs have commands and positions at 500 Hz with an encoder's noise. Both get the model,
the logs, the bounds and all cores, and start from the model as given. `mujoco.sysid` is used as its
documentation has it, with the faster of its optimizers and its own normalisation of residuals; what
it minimises then is the cost of both, worked out for both by a simulation here, beside the cost on
a log that neither has seen. The seconds are of everything from the logs in memory to the values:
that of `gap.fit` includes standard errors.
"""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import mujoco.rollout
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

from benchmarks import Row
from benchmarks.hidden.rigs import RATE, write_rig
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.tasks.excitation import BATTERY

FloatArray = NDArray[np.float64]
Optimizer = Literal["mujoco", "scipy", "scipy_parallel_fd"]

REQUIRED = 3.0
EQUAL = 1e-3  # of the cost: less is what optimizers with different tolerances differ by
LOGS = ("chirp", "slow_triangle", "multisine", "steps")  # the last is held out
SECONDS, QUICK_SECONDS = 10.0, 3.0
NOISE = 1e-4  # rad, of the encoders
_RIGS = {3: "leg", 12: "hung_quadruped"}
_OPTIMIZERS: tuple[Optimizer, ...] = ("mujoco", "scipy_parallel_fd")
_OURS = {"armature": "armature", "damping": "viscous_friction", "frictionloss": "coulomb_friction"}
_ROOM, _SPEED, _SETTLE = 0.35, 6.0, 1.0
_MOST_ITERATIONS = 100


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A robot, its model and its logs.

    Attributes:
        path: the model's file.
        spec: the same, with a sensor of each joint's position.
        joints: names, in the order of the actuators.
        logs: commands and positions, the last one held out.
        bounds: of each of `_OURS` at each joint, (3, n_joints, 2).
        true: (3, n_joints).
    """

    path: Path
    spec: mujoco.MjSpec
    joints: tuple[str, ...]
    logs: tuple[gap.Recording, ...]
    true: FloatArray

    def given(self) -> FloatArray:
        """(3, n_joints) values of the model as given."""
        model = self.spec.compile()
        dofs = [int(model.joint(name).dofadr[0]) for name in self.joints]
        return np.stack([getattr(model, f"dof_{name}")[dofs] for name in _OURS])


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a method found.

    Attributes:
        values: (3, n_joints) of armature, damping and frictionloss.
        seconds: it took.
    """

    values: FloatArray
    seconds: float


def run(*, quick: bool) -> list[Row]:
    """Fits by both, in turns."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for n in (3,) if quick else (3, 12):
            rig = make(_RIGS[n], Path(folder), seconds=QUICK_SECONDS if quick else SECONDS)
            bounds = _bounds(rig)
            theirs = {
                name: by_sysid(rig, bounds, name)
                for name in (_OPTIMIZERS[:1] if quick else _OPTIMIZERS)
            }
            ours = by_gap(rig)
            rows += _compared(rig, ours, theirs)
    return rows


def _compared(rig: Rig, ours: Found, theirs: dict[Optimizer, Found]) -> list[Row]:
    name, reference = min(theirs.items(), key=lambda item: item[1].seconds)
    for method, found in {"as given": None, "gap.fit": ours, **theirs}.items():
        values = rig.given() if found is None else found.values
        took = "" if found is None else f"{found.seconds:.1f} s, "
        print(
            f"  {len(rig.joints)} joints, {method}: {took}cost {cost(rig, values):.6e}, "
            f"held out {cost(rig, values, held_out=True):.6e}",
            flush=True,
        )
    own, other = cost(rig, ours.values), cost(rig, reference.values)
    what = f"fit armature, damping, frictionloss of {len(rig.joints)} joints, three "
    what += f"{rig.logs[0].time[-1]:.0f} s logs"
    return [
        Row(
            what=what,
            result=f"{ours.seconds:.1f} s, {reference.seconds / ours.seconds:.1f}x faster",
            reference=f"mujoco.sysid ({name}): {reference.seconds:.1f} s",
            required=f">= {REQUIRED:g}x",
        ),
        Row(
            what="its final cost, over that of mujoco.sysid",
            result=f"{own / other:.4f}",
            reference=f"{other:.4e}; held out "
            f"{cost(rig, ours.values, held_out=True):.3e} against "
            f"{cost(rig, reference.values, held_out=True):.3e}",
            required=f"<= {1 + EQUAL:g}",
        ),
    ]


def make(name: str, folder: Path, *, seconds: float, seed: int = 0) -> Rig:
    """Writes a robot's model and records what the robot does.

    Args:
        name: one of the rigs of the hidden-effects benchmark.
        folder: for the model.
        seconds: length of each log.
        seed: of what differs, of the experiments and the noise.
    """
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_file(str(write_rig(name, folder, file=f"{name}_rig.xml")))
    for sensor in list(spec.sensors):  # the measured ones have to be the first
        spec.delete(sensor)
    model = spec.compile()
    joints = tuple(model.joint(int(model.actuator_trnid[k, 0])).name for k in range(model.nu))
    true = np.empty((len(_OURS), len(joints)))
    for k, joint in enumerate(map(spec.joint, joints)):
        # Dry friction that does not creep, in both.
        joint.solref_friction = [2 * model.opt.timestep, 1.0]
        joint.solimp_friction = [0.99, 0.99, 0.001, 0.5, 2.0]
        joint.frictionloss = 0.02
        inertia = float(model.dof_M0[model.jnt_dofadr[model.joint(joint.name).id]])
        damping = float(joint.damping[0])
        true[:, k] = (
            float(joint.armature) + inertia * rng.uniform(0.1, 0.4),
            damping + rng.uniform(0.1, 0.5),
            rng.uniform(0.1, 0.5),
        )
    spec.compile()
    path = folder / f"{name}_given.xml"
    path.write_text(spec.to_xml(), encoding="utf-8")
    for joint_name in joints:
        spec.add_sensor(
            name=joint_name,
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint_name,
        )
    logs = []
    home = model.key_qpos[0] if model.nkey else model.qpos0
    for signal in LOGS:
        clock = np.arange(round(seconds * RATE)) / RATE
        ids = model.actuator_trnid[:, 0]
        middle = home[model.jnt_qposadr[ids]]
        reach = _ROOM / 2 * np.ptp(model.jnt_range[ids], axis=1)
        low = np.maximum(model.jnt_range[ids, 0], middle - reach)
        high = np.minimum(model.jnt_range[ids, 1], middle + reach)
        sent = BATTERY[signal](clock, lower=low, upper=high, rng=rng, max_velocity=_SPEED)
        moved = _simulated(_with(spec, joints, true), joints, sent, None)
        columns = {}
        for k, joint_name in enumerate(joints):
            noise = rng.normal(scale=NOISE, size=len(clock))
            columns[f"{joint_name}/position_target"] = sent[:, k]
            columns[f"{joint_name}/position"] = moved[:, k] + noise
        logs.append(gap.Recording(name=signal, time=clock, columns=columns))
    return Rig(path=path, spec=spec, joints=joints, logs=tuple(logs), true=true)


def by_gap(rig: Rig) -> Found:
    """The values that `gap.fit` finds."""
    load, fit = gap.load, gap.fit  # imported now, as sysid is
    start = time.perf_counter()
    problem = load(rig.path, rig.logs, held_out=rig.logs[-1:], hold="zero_order")
    fitted = fit(problem, dict.fromkeys(_OURS.values(), "*"))
    added = [
        [fitted.value(effect, name, joint) for joint in rig.joints]
        for name, effect in _OURS.items()
    ]
    return Found(values=rig.given() + added, seconds=time.perf_counter() - start)


def by_sysid(rig: Rig, bounds: FloatArray, optimizer: Optimizer) -> Found:
    """The values that `mujoco.sysid` finds.

    Args:
        rig: the robot.
        bounds: what `_bounds` returned.
        optimizer: one of its own.
    """
    start = time.perf_counter()
    spec = rig.spec.copy()
    parameters = sysid.ParameterDict()
    given = rig.given()
    for i, field in enumerate(_OURS):
        for k, joint in enumerate(rig.joints):

            def modify(of: mujoco.MjSpec, p: Any, joint: str = joint, field: str = field) -> None:
                _set(of.joint(joint), field, float(p.value[0]))

            low, high = bounds[i, k]
            parameters.add(
                sysid.Parameter(f"{joint}/{field}", given[i, k], low, high, modifier=modify)
            )
    model = spec.compile()
    step = model.opt.timestep
    mapping = sysid.TimeSeries.compute_all_sensor_mapping(model)
    starts, controls, measured = [], [], []
    for log in rig.logs[:-1]:
        sent, seen = _columns(rig, log, "position_target"), _columns(rig, log, "position")
        qpos = np.zeros(model.nq)
        qpos[_addresses(model, rig.joints)] = seen[0]
        starts.append(sysid.create_initial_state(model, qpos, np.zeros(model.nv)))
        # Held targets on the timestep's grid: its resampling would interpolate between them.
        every = round(1 / RATE / step)
        grid = step * np.arange(every * (len(sent) - 1) + 1)
        held = np.repeat(sent, every, axis=0)[: len(grid)]
        controls.append(sysid.TimeSeries((1 - 1e-12) * grid, held))
        # Its rollout reads sensors as a step begins, and stamps them as it ends.
        measured.append(sysid.TimeSeries(log.time[:-1] + step, seen[:-1], mapping))
    names = [log.name for log in rig.logs[:-1]]
    sequences = sysid.ModelSequences(rig.path.stem, spec, names, starts, controls, measured)
    found, _ = sysid.optimize(
        parameters,
        sysid.build_residual_fn(models_sequences=[sequences]),
        optimizer,
        verbose=False,
        max_iters=_MOST_ITERATIONS,
        x_scale="jac",
        **({"output": io.StringIO()} if optimizer == "mujoco" else {}),
    )
    values = np.reshape(found.as_vector(), given.shape)
    return Found(values=values, seconds=time.perf_counter() - start)


def cost(rig: Rig, values: FloatArray, *, held_out: bool = False) -> float:
    """Squared errors of the positions of each log and joint, over those of the positions.

    Args:
        rig: the robot.
        values: (3, n_joints).
        held_out: on the log that is held out, instead of those that are fitted.
    """
    model = _with(rig.spec, rig.joints, values)
    total = 0.0
    for log in rig.logs[-1:] if held_out else rig.logs[:-1]:
        seen = _columns(rig, log, "position")
        moved = _simulated(model, rig.joints, _columns(rig, log, "position_target"), seen[0])
        total += float((((moved - seen) ** 2).sum(axis=0) / (seen**2).sum(axis=0)).sum())
    return total


def _bounds(rig: Rig) -> FloatArray:
    """(3, n_joints, 2) between which `gap.fit` looks for each value."""
    problem = gap.load(rig.path, rig.logs, held_out=rig.logs[-1:], hold="zero_order")
    terms = candidate_terms(
        [CATALOGUE[name] for name in _OURS.values()], problem.robots, problem.joints
    )
    slots = Structure(terms, problem.robots).slots
    found = {(s.term.effect.name, s.place): (s.parameter.lower, s.parameter.upper) for s in slots}
    added = [[found[effect, joint] for joint in rig.joints] for effect in _OURS.values()]
    return rig.given()[:, :, None] + np.array(added)


def _with(spec: mujoco.MjSpec, joints: Sequence[str], values: FloatArray) -> mujoco.MjModel:
    changed = spec.copy()
    for field, row in zip(_OURS, values, strict=True):
        for name, value in zip(joints, row, strict=True):
            _set(changed.joint(name), field, float(value))
    return changed.compile()


def _set(joint: Any, field: str, value: float) -> None:
    setattr(joint, field, [value, 0.0, 0.0] if field == "damping" else value)


def _simulated(
    model: mujoco.MjModel, joints: Sequence[str], sent: FloatArray, start: FloatArray | None
) -> FloatArray:
    """(T, n_joints) positions under targets that are held; by default from rest at the first."""
    data = mujoco.MjData(model)
    at = _addresses(model, joints)
    data.qpos[at] = sent[0] if start is None else start
    every = round(1 / RATE / model.opt.timestep)
    if start is None:
        data.ctrl[:] = sent[0]
        mujoco.mj_step(model, data, round(_SETTLE / model.opt.timestep))
        data.time = 0.0
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    begun = data.qpos[at].copy()
    held = np.repeat(sent[:-1], every, axis=0)
    states, _ = mujoco.rollout.rollout(model, data, state, held)
    later = states[0][every - 1 :: every, 1 + at]
    return np.concatenate([begun[None], later])


def _addresses(model: mujoco.MjModel, joints: Sequence[str]) -> NDArray[np.intp]:
    return np.array([int(model.joint(name).qposadr[0]) for name in joints], dtype=np.intp)


def _columns(rig: Rig, log: gap.Recording, signal: str) -> FloatArray:
    return np.stack([log.columns[f"{joint}/{signal}"] for joint in rig.joints], axis=1)
