"""Compiles the robot.py of folders by mjlab; prints its actuators and what they are given."""

import importlib.util
import json
import sys
from pathlib import Path

from mjlab.entity import Entity

for name in sys.argv[1:]:
    spec = importlib.util.spec_from_file_location("robot", Path(name) / "robot.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entity = Entity(module.ROBOT)
    model = entity.compile()
    kinds = sorted({type(cfg).__name__ for cfg in module.ROBOT.articulation.actuators})
    lags = sorted({cfg.delay_max_lag for cfg in module.ROBOT.articulation.actuators})
    numbers = {
        "damping": model.dof_damping.tolist(),
        "frictionloss": model.dof_frictionloss.tolist(),
        "armature": model.dof_armature.tolist(),
    }
    print(json.dumps([Path(name).name, kinds, lags, model.nu, numbers]), flush=True)
