"""Plays targets in MuJoCo Warp on the CPU: folders with model.xml and targets.npy → warp.npy."""

import sys
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import numpy as np

for name in sys.argv[1:]:
    folder = Path(name)
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    targets = np.load(folder / "targets.npy")
    put, state = mjw.put_model(model), mjw.put_data(model, data)
    found = []
    for target in targets:
        state.ctrl.assign(target[None].astype(np.float32))
        mjw.step(put, state)
        found.append(state.qpos.numpy()[0].copy())
    np.save(folder / "warp.npy", np.array(found))
    print(folder.name, flush=True)
