"""A hanging leg, and diagnoses of it, for what other environments play."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.deliver.written import write_mended
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Excursion, Robot, load_robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar

FloatArray = NDArray[np.float64]

LEG = """<mujoco model="leg">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="thigh" pos="0 0 2">
      <joint name="hip" axis="0 1 0" damping="0.3" armature="0.02" frictionloss="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1" contype="0"/>
      <body name="shank" pos="0 0 -0.3">
        <joint name="knee" axis="0 1 0" damping="0.2" armature="0.01"/>
        <geom name="foot" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="hip" kp="40" kv="1" forcerange="-20 20"/>
    <position joint="knee" kp="30" kv="1" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""
SEEN = Excursion(lower=-0.6, upper=0.7, velocity=4.0, acceleration=60.0, effort=6.0)


def leg_at(path: Path) -> Robot:
    """The leg, from a file that is written first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(LEG, encoding="utf-8")
    robot = load_robot(path)
    return replace(robot, excursions=dict.fromkeys(robot.joints, SEEN))


def structure_of(robot: Robot, name: str) -> tuple[Structure, FloatArray]:
    """An effect on all of a robot, with values that do something."""
    (term,) = candidate_terms([CATALOGUE[name]], [robot], [*robot.joints])
    structure = Structure((term,), (robot,))
    return structure, np.array([slot.parameter.starts[-1] for slot in structure.slots])


def mended_with(robot: Robot, name: str) -> Robot:
    """The robot with an effect."""
    structure, values = structure_of(robot, name)
    return mend(structure.trials(robot, values[None]))


def diagnosed(folder: Path, name: str) -> Robot:
    """Saves what a diagnosis of the leg would have found; returns the mended robot."""
    robot = leg_at(folder / "own" / "leg.xml")
    structure, values = structure_of(robot, name)
    mended = mend(structure.trials(robot, values[None]))
    (term,) = structure.terms
    kind = "body" if term.effect.kind == "body" else "joint"
    parameters = []
    for slot, value in zip(structure.slots, values, strict=True):
        field = term.effect.fields[slot.parameter.name]
        site = term.sites[0] if slot.place == EVERYWHERE else slot.place
        was, now = (field.read(one, site, robot) for one in (robot, mended))
        parameters.append(
            {
                "name": slot.parameter.name,
                kind: slot.place,
                "value": float(value),
                "std": 0.02 * abs(float(value)),
                "unit": slot.parameter.unit,
                "was": was,
                "is": now,
                "field": field.path,
                "at_bound": False,
            }
        )
    effect = {
        "effect": name,
        "joints": [] if kind == "body" else list(term.sites),
        **({"bodies": list(term.sites)} if kind == "body" else {}),
        "parameters": parameters,
        "indistinguishable_from": [],
    }
    result = folder / "result"
    result.mkdir()
    write_mended(robot, mended, result / "model.xml")
    content = json.dumps(sidecar({"model.xml": mended}, [effect]))
    (result / FILE).write_text(content, encoding="utf-8")
    (result / "diagnosis.json").write_text(json.dumps({"effects": [effect]}), encoding="utf-8")
    return mended
