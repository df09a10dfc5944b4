"""An inverted pendulum that a policy balances by what it observes, and findings about it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from dm_control import composer
from dm_control.locomotion.arenas import floors

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.structure import Structure, Term, candidate_terms
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar

PENDULUM = """<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="rod" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.01" armature="0.001"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.02" mass="1" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><motor name="hinge" joint="hinge" ctrlrange="-20 20" forcerange="-20 20"/></actuator>
</mujoco>
"""
FALLEN = 0.5  # rad
SECONDS = 2.0
Values = Mapping[str, float]


class Balance(composer.Task):  # type: ignore[misc]
    """Up to two seconds of balancing; a reward of 1 for each control step, and a fall ends it."""

    def __init__(self, walker: Any, physics_timestep: float | None = None):
        self._walker = walker
        self._arena = floors.Floor()
        self._arena.attach(walker)
        if physics_timestep is None:
            physics_timestep = walker.mjcf_model.option.timestep
        self.set_timesteps(control_timestep=0.01, physics_timestep=physics_timestep)
        for name in ("joints_pos", "joints_vel"):
            walker.observables.as_dict(fully_qualified=False)[name].enabled = True

    @property
    def root_entity(self) -> Any:
        return self._arena

    @property
    def walker(self) -> Any:
        return self._walker

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        bound = physics.bind(self._walker.observable_joints)
        bound.qpos = random_state.uniform(-0.1, 0.1, 1)

    def action_spec(self, physics: Any) -> Any:
        return self._walker.action_spec

    def before_step(self, physics: Any, action: Any, random_state: Any) -> None:
        self._walker.apply_action(physics, action, random_state)

    def get_reward(self, physics: Any) -> float:
        return 1.0

    def _down(self, physics: Any) -> bool:
        return bool(abs(physics.bind(self._walker.observable_joints).qpos[0]) > FALLEN)

    def should_terminate_episode(self, physics: Any) -> bool:
        return self._down(physics)

    def get_discount(self, physics: Any) -> float:
        return 0.0 if self._down(physics) else 1.0


def make_environment(robot: Any) -> composer.Environment:
    return composer.Environment(Balance(robot.walker()), time_limit=SECONDS)


GAINS = np.array([[-2.0, -0.15]])  # of an action, per rad and rad/s


def policy(timestep: Any) -> Any:
    """Torque against what is observed of angle and speed."""
    observed = [np.ravel(value) for value in timestep.observation.values()]
    return np.clip(GAINS @ np.concatenate(observed), -1.0, 1.0)


def pendulum(folder: Path, text: str = PENDULUM) -> Path:
    """The pendulum's file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pendulum.xml").write_text(text)
    return folder / "pendulum.xml"


def term_of(robot: Robot, name: str) -> Term:
    (term,) = candidate_terms([CATALOGUE[name]], [robot], [*robot.joints])
    return term


def saved(
    folder: Path,
    robot: Robot | Path,
    named: Mapping[str, Values],
    *,
    rivals: Sequence[tuple[str, Values]] = (),
    next_experiment: Mapping[str, Any] | None = None,
    fewer: Mapping[str, Sequence[str]] | None = None,
) -> Path:
    """Saves what a diagnosis would have found.

    Args:
        folder: made.
        robot: the robot as it was given, or its file.
        named: effect to its parameters, the same at every site.
        rivals: what may be in the place of the last one.
        next_experiment: as in diagnosis.json.
        fewer: effect to others that it cannot be told from.
    """
    robot = load_robot(robot) if isinstance(robot, Path) else robot
    mended, effects = _mended(robot, named)
    for effect in effects:
        effect["indistinguishable_from"] = list((fewer or {}).get(effect["effect"], ()))
    last = [*named][-1]
    kept = {name: values for name, values in named.items() if name != last}
    content = {
        "schema": 2,
        "effects": effects,
        "rivals": [
            {"effect": name, "in_place_of": last, "effects": _mended(robot, {**kept, name: of})[1]}
            for name, of in rivals
        ],
        "next_experiment": next_experiment,
    }
    folder.mkdir(parents=True)
    write_model(mended, folder / "model.xml")
    beside = json.dumps(sidecar({"model.xml": mended}, effects))
    (folder / FILE).write_text(beside, encoding="utf-8")
    (folder / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def _mended(robot: Robot, named: Mapping[str, Values]) -> tuple[Robot, list[dict[str, Any]]]:
    structure = Structure(tuple(term_of(robot, name) for name in named), (robot,))
    values = np.array([named[s.term.effect.name][s.parameter.name] for s in structure.slots])
    mended = mend(structure.trials(robot, values[None]))
    effects = []
    for term in structure.terms:
        parameters = []
        for i in structure.columns(term):
            slot = structure.slots[i]
            field = term.effect.fields[slot.parameter.name]
            site = term.sites[0] if slot.place == EVERYWHERE else slot.place
            was, now = (field.read(one, site, robot) for one in (robot, mended))
            parameters.append(
                {
                    "name": slot.parameter.name,
                    "joint": slot.place,
                    "value": float(values[i]),
                    "was": was,
                    "is": now,
                    "field": field.path,
                }
            )
        effects.append(
            {
                "effect": term.effect.name,
                "joints": ["*"] if term.shared else list(term.sites),
                "parameters": parameters,
                "indistinguishable_from": [],
            }
        )
    return mended, effects
