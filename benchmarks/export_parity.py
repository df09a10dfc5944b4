"""Exported models in the trainers themselves, against MuJoCo: the same targets for two seconds.

The reference is MuJoCo on the mended model. Where a law is at work, the exported functions run
around MuJoCo's own steps in double precision; tests hold these to the library's laws.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks import Row
from benchmarks.trainers.environments import python_with, run_in
from benchmarks.trainers.legs import diagnosed, leg_with
from walkerkit.gap.deliver import export
from walkerkit.gap.deliver.law_code import all_laws, law_code
from walkerkit.gap.deliver.trainers import way
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

SECONDS, MOST = 2.0, 1e-3
QUICK = ("viscous_friction", "coulomb_friction", "payload", "command_delay", "slew_limit")
MJX = ("mujoco-mjx==3.17.0", "mujoco==3.17.0")
WARP = ("mujoco-warp==3.17.0", "mujoco==3.17.0")
MJLAB = ("mjlab==1.6.0",)


def run(*, quick: bool) -> list[Row]:
    """The largest difference of a joint's position, per trainer."""
    names = QUICK if quick else tuple(CATALOGUE)
    with tempfile.TemporaryDirectory() as made:
        folders, wanted, in_mjlab = {}, {}, {}
        for name in names:
            robot = leg_with(name, Path(made) / name / "own" / "leg.xml")
            mended = diagnosed(Path(made) / name / "result", robot, name)
            targets = _targets(float(mended.model.opt.timestep))
            for trainer in ("mjx", "warp", "mjlab"):
                done = export(Path(made) / name / "result", trainer)
                renamed = done.folder.rename(done.folder.with_name(f"{name}-{trainer}"))
                np.save(renamed / "targets.npy", targets)
                folders[name, trainer] = renamed
            wanted[name] = _reference(mended, targets)
            if mended.model.actuator_delay.any() and not mended.laws:
                in_mjlab[name] = _reference(_in_whole_steps(mended), targets)
            elif way(name, "mjlab").kind == "config" and mended.laws:
                in_mjlab[name] = _with_laws(mended, mended.laws, targets, explicit=True)
        rows = [_compared("mjx", MJX, names, folders, wanted)]
        plain = tuple(n for n in names if not (folders[n, "warp"] / "drivetrain.py").exists())
        rows.append(_compared("warp", WARP, plain, folders, wanted))
        said = run_in(python_with(*MJLAB), "mjlab_side.py", *(folders[n, "mjlab"] for n in names))
        compiled = [json.loads(line) for line in said.splitlines() if line.startswith("[")]
        for one in compiled:  # Warp says besides what it loads
            print("mjlab", *one[:4])
        rows.append(
            Row(
                what="configs that compile, mjlab",
                result=f"{len(compiled)} of {len(names)}",
                reference="",
                required="all",
            )
        )
        plain = tuple(n for n in names if (folders[n, "mjlab"] / "mjlab.npy").exists())
        rows.append(
            _errors("mjlab", plain, folders, {n: in_mjlab.get(n, wanted[n]) for n in plain})
        )
    return rows


def _compared(
    trainer: str,
    packages: tuple[str, ...],
    names: tuple[str, ...],
    folders: dict[tuple[str, str], Path],
    wanted: dict[str, FloatArray],
) -> Row:
    run_in(python_with(*packages), f"{trainer}_side.py", *(folders[n, trainer] for n in names))
    return _errors(trainer, names, folders, wanted)


def _errors(
    trainer: str,
    names: tuple[str, ...],
    folders: dict[tuple[str, str], Path],
    wanted: dict[str, FloatArray],
) -> Row:
    errors = {}
    for name in names:
        found = np.load(folders[name, trainer] / f"{trainer}.npy")
        # mjlab tells joints alone, without the base that comes first.
        errors[name] = float(np.abs(found - wanted[name][:, -found.shape[1] :]).max())
        kind = way(name, trainer).kind  # type: ignore[arg-type]
        print(f"{trainer} {name} ({kind}): {1e3 * errors[name]:.3g} mrad", flush=True)
    within = sum(error < MOST for error in errors.values())
    return Row(
        what=f"effects within 1 mrad over {SECONDS:g} s, {trainer}",
        result=f"{within} of {len(names)}; worst {1e3 * max(errors.values()):.2g} mrad",
        reference="MuJoCo",
        required="all",
    )


def _targets(step: float) -> FloatArray:
    time = step * np.arange(round(SECONDS / step))
    # Within what the servos can do: at a limit MJX integrates their damping as if there was none.
    hip = 0.3 * np.sin(5 * time + 2 * time**2)
    knee = 0.2 * np.sign(np.sin(6 * time)) * (time > 0.1)
    return np.stack([hip, knee], axis=1)


def _reference(mended: Robot, targets: FloatArray) -> FloatArray:
    """(n_steps, nq) positions by MuJoCo."""
    model = mended.model
    data = mujoco.MjData(model)
    laws = all_laws(mended, delays=bool(mended.laws), drag=False) if mended.laws else {}
    if laws:
        return _with_laws(mended, laws, targets)
    for actuator in np.flatnonzero(model.actuator_delay > 0):
        # As if the first target had come for ever.
        times = (
            data.time - model.opt.timestep * np.arange(model.actuator_history[actuator, 0])[::-1]
        )
        values = np.full(len(times), targets[0, actuator])
        mujoco.mj_initCtrlHistory(model, data, int(actuator), times, values)
    found = []
    for target in targets:
        data.ctrl[:] = target
        mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return np.array(found)


def _in_whole_steps(mended: Robot) -> Robot:
    """The robot with delays as mjlab has them, which its export tells."""
    model = mended.spec.copy().compile()
    step = model.opt.timestep
    model.actuator_delay[:] = np.round(model.actuator_delay / step) * step
    return replace(mended, model=model)


def _with_laws(
    mended: Robot, laws: Any, targets: FloatArray, *, explicit: bool = False
) -> FloatArray:
    """(n_steps, nq) positions by MuJoCo and the exported laws; servos may damp explicitly."""
    import torch

    torch.set_num_threads(1)
    made: dict[str, Any] = {}
    text = law_code(mended, laws, "torch").replace("torch.float32", "torch.float64")
    exec(compile(text, "drivetrain.py", "exec"), made)
    model = mended.spec.copy().compile()
    model.actuator_delay[:] = 0.0
    if explicit:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data, state, found = mujoco.MjData(model), made["start"](), []
    for target in targets:
        seen = (target, data.qpos[made["QPOS"]], data.qvel[made["DOFS"]])
        held = data.qfrc_constraint[made["DOFS"]]
        play, play_speed = np.zeros_like(target), np.zeros_like(target)
        for column, qpos, dof in made["PLAYS"]:
            play[column], play_speed[column] = data.qpos[qpos], data.qvel[dof]
        state, ctrl, applied, dry = made["before_step"](
            state, *(torch.as_tensor(np.array(one)) for one in (*seen, held, play, play_speed))
        )
        data.ctrl[made["ACTUATORS"]] = ctrl.numpy()
        data.qfrc_applied[made["DOFS"]] = applied.numpy()
        if explicit:
            robot = made["ROBOT"]
            servo = made["asked"](robot, ctrl, *(torch.as_tensor(one) for one in seen[1:]))
            servo = made["clipped"](servo, *robot["effort_range"])
            data.qfrc_applied[made["DOFS"]] += servo.numpy()
        model.dof_frictionloss[made["DOFS"]] = dry.numpy()
        mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return np.array(found)
