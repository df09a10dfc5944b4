"""Plays targets in mjlab: folders with robot.py and targets.npy → mjlab.npy; prints what it took.

Where laws are in drivetrain.py, which a user's actuator would call, the robot is compiled alone.
"""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import torch
from mjlab.entity import Entity
from mjlab.scene import Scene, SceneCfg
from mjlab.sim import Simulation


def played(module, targets):
    """(n_steps, n_joints) positions of the robot alone in a scene."""
    scene = Scene(SceneCfg(num_envs=1, entities={"robot": module.ROBOT}), device="cpu")
    model = scene.compile()
    simulation = Simulation(num_envs=1, cfg=module.SIMULATION, model=model, device="cpu")
    scene.initialize(simulation.mj_model, simulation.model, simulation.data)
    robot, found = scene["robot"], []
    driven = [name for cfg in module.ROBOT.articulation.actuators for name in cfg.target_names_expr]
    joints, _ = robot.find_joints(driven)  # in the model's order
    for target in targets:
        sent = torch.as_tensor(target, dtype=torch.float32)[None]
        robot.set_joint_position_target(sent, joint_ids=joints)
        scene.write_data_to_sim()
        simulation.step()
        scene.update(model.opt.timestep)
        found.append(robot.data.joint_pos[0].numpy().copy())
    return np.array(found)


for name in sys.argv[1:]:
    folder = Path(name)
    spec = importlib.util.spec_from_file_location("robot", folder / "robot.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    model = Entity(module.ROBOT).compile()
    kinds = sorted({type(cfg).__name__ for cfg in module.ROBOT.articulation.actuators})
    lags = sorted({cfg.delay_max_lag for cfg in module.ROBOT.articulation.actuators})
    if not (folder / "drivetrain.py").exists():
        np.save(folder / "mjlab.npy", played(module, np.load(folder / "targets.npy")))
    numbers = {
        "damping": model.dof_damping.tolist(),
        "frictionloss": model.dof_frictionloss.tolist(),
        "armature": model.dof_armature.tolist(),
    }
    print(json.dumps([folder.name, kinds, lags, model.nu, numbers]), flush=True)
