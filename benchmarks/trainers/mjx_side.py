"""Plays targets in MJX: folders with model.xml, maybe drivetrain.py, and targets.npy → mjx.npy."""

import importlib.util
import sys
from pathlib import Path

import jax
import mujoco
import numpy as np
from mujoco import mjx


def code_of(folder):
    """The laws of a folder, or None."""
    path = folder / "drivetrain.py"
    if not path.exists():
        return None
    spec = importlib.util.spec_from_file_location("drivetrain", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@jax.jit
def plain(model, data, targets):
    """(n_steps, nq) positions of a model alone."""

    def step(data, ctrl):
        data = mjx.step(model, data.replace(ctrl=ctrl))
        return data, data.qpos

    return jax.lax.scan(step, data, targets)[1]


def with_laws(code, model, data, targets):
    """The same with laws around its steps."""

    @jax.jit
    def play(model, data, state, targets):
        def step(carry, target):
            data, state = code.mjx_step(model, *carry, target)
            return (data, state), data.qpos

        return jax.lax.scan(step, (data, state), targets)[1]

    return play(model, data, code.start(), targets)


for name in sys.argv[1:]:
    folder = Path(name)
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mjx.make_data(model)
    targets = np.load(folder / "targets.npy")
    code = code_of(folder)
    put = mjx.put_model(model)
    found = plain(put, data, targets) if code is None else with_laws(code, put, data, targets)
    np.save(folder / "mjx.npy", np.asarray(found))
    print(folder.name, flush=True)
