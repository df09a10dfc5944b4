"""A leg in a file that does all a file can to its numbers, and diagnoses of it."""

import json
from dataclasses import replace

import numpy as np

from walkerkit.gap.deliver.written import write_mended
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Excursion, load_robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar

# Degrees, classes, frames, unnamed elements, both quotes, an attribute on a line of its own.
AWKWARD = """<?xml version="1.0"?>
<!-- knee > hip -->
<mujoco model='a "leg"'>
  <compiler autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"><flag eulerdamp="enable"/></option>
  <default>
    <joint armature="0.01" damping="0.2"/>
    <default class="leg"><joint range="-80 80" frictionloss='0.05'/>
      <position kp="40" kv="1" forcerange="-9 9"/></default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="thigh" pos="0 0 2" childclass="leg">
      <joint
          name = "hip"
          axis="1 0 0"
      />
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1" contype="0"/>
      <frame pos="0 0 -0.3" euler="0 0 20">
        <body name="shank"><inertial pos="0 0 -0.1" mass="0.5" diaginertia="1e-3 1e-3 1e-4"/>
          <joint name="knee" axis="0 1 0" stiffness="0.3" springref="11"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/></body>
      </frame>
    </body>
  </worldbody>
  <actuator>
    <position class="leg" joint="hip"/><position class="leg" joint="knee" kp="25" ></position>
  </actuator>
  <keyframe><key name="home" qpos="0.1 0.2"/></keyframe>
</mujoco>
"""
SEEN = Excursion(lower=-0.6, upper=0.7, velocity=3.0, acceleration=40.0, effort=5.0)


def robot_at(path, text=AWKWARD):
    """The robot of a file that is written first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode())
    robot = load_robot(path)
    return replace(robot, excursions=dict.fromkeys(robot.joints, SEEN))


def found_in(robot, name, sites=None):
    """An effect of some size: its structure and its values."""
    effect = CATALOGUE[name]
    (term,) = candidate_terms([effect], [robot], [*robot.joints])
    structure = Structure((replace(term, sites=sites) if sites else term,), (robot,))
    values = [
        slot.parameter.starts[0]
        if slot.parameter.choice
        else slot.parameter.starts[-1] * 0.8127364523 + slot.parameter.starts[0] * 0.1234567
        for slot in structure.slots
    ]
    return structure, np.array(values)


def with_effect(robot, name, sites=None):
    """The robot with an effect of some size."""
    structure, values = found_in(robot, name, sites)
    return mend(structure.trials(robot, values[None]))


def diagnosis_in(folder, robot, name, sites=None):
    """Saves what a diagnosis would have found; returns the mended robot."""
    structure, values = found_in(robot, name, sites)
    mended = mend(structure.trials(robot, values[None]))
    (term,) = structure.terms
    place = "body" if term.effect.kind == "body" else "joint"
    parameters = []
    for slot, value in zip(structure.slots, values, strict=True):
        field = term.effect.fields[slot.parameter.name]
        site = term.sites[0] if slot.place == EVERYWHERE else slot.place
        was, now = (field.read(one, site, robot) for one in (robot, mended))
        parameters.append(
            {
                "name": slot.parameter.name,
                place: slot.place,
                "value": float(f"{value:.6g}"),
                "std": 0.02 * abs(value),
                "unit": slot.parameter.unit,
                "was": was,
                "is": now,
                "field": field.path,
                "at_bound": False,
            }
        )
    effect = {
        "effect": name,
        "joints": [] if place == "body" else ["*"] if term.shared else list(term.sites),
        **({"bodies": list(term.sites)} if place == "body" else {}),
        "confidence": 0.9,
        "parameters": parameters,
        "indistinguishable_from": [],
    }
    folder.mkdir(parents=True)
    write_mended(robot, mended, folder / "model.xml")
    (folder / FILE).write_text(json.dumps(sidecar({"model.xml": mended}, [effect])))
    (folder / "diagnosis.json").write_text(json.dumps({"schema": 2, "effects": [effect]}))
    return mended
