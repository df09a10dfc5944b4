"""The simulation itself."""

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.trials import Trials


class TestTimestep(EffectContract):
    name = "timestep"
    chosen = True

    def plant(self, machine):
        machine.model.opt.timestep /= 4
        machine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        return {"*": [0.0005, 1]}

    @pytest.mark.parametrize("factor", [2, 4])
    def test_robot_with_shorter_steps_makes_as_many_in_place_of_one(self, plain, factor):
        given, _ = plain
        for robot in (given.refined(factor), given.coarsened(factor)):
            own = robot.model.opt.timestep
            trials = Trials(robot, 1)
            CATALOGUE["timestep"].apply(trials, "*", np.array([[0.0005, 0.0]]))
            assert trials.fields["opt.timestep"] == pytest.approx(own / 4)
