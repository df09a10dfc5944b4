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
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.robot import Excursion, Robot
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
_TRUNK = """<body name="trunk" pos="0 0 2"><freejoint name="base"/>
      <geom type="box" size="0.1 0.1 0.05" mass="2" contype="0"/>
      <body name="thigh">"""
FLOATING = (
    LEG.replace("<option ", '<option gravity="0 0 0" ')
    .replace('<body name="thigh" pos="0 0 2">', _TRUNK)
    .replace("</body>\n  </worldbody>", "</body></body>\n  </worldbody>")
)
"""The same below a trunk, without weight: what stands has effects that what hangs has not."""
SEEN = Excursion(
    lower=-0.6,
    upper=0.7,
    velocity=4.0,
    acceleration=60.0,
    effort=6.0,
    voltage=(24.0, 21.0, 25.5),
)


def leg_with(name: str, path: Path) -> Robot:
    """The leg from a file that is written first, or the floating one for what only that has."""
    for text in (LEG, FLOATING):
        robot = leg_at(path, text)
        if candidate_terms([CATALOGUE[name]], [robot], [*robot.joints]):
            return robot
    raise ValueError(f"neither leg can have {name}")


def leg_at(path: Path, text: str = LEG) -> Robot:
    """The leg, or another robot, from a file that is written first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode())
    robot = load_robot(path)
    return replace(robot, excursions=dict.fromkeys(robot.joints, SEEN))


def found_in(
    robot: Robot, name: str, sites: tuple[str, ...] | None = None
) -> tuple[Structure, FloatArray]:
    """An effect of some size: its structure and its values, which have many digits."""
    (term,) = candidate_terms([CATALOGUE[name]], [robot], [*robot.joints])
    structure = Structure((replace(term, sites=sites) if sites else term,), (robot,))
    values = [
        slot.parameter.starts[0]
        if slot.parameter.choice
        else slot.parameter.starts[-1] * 0.8127364523 + slot.parameter.starts[0] * 0.1234567
        for slot in structure.slots
    ]
    return structure, np.array(values)


def mended_with(robot: Robot, name: str, sites: tuple[str, ...] | None = None) -> Robot:
    """The robot with an effect of some size, at all sites or some."""
    structure, values = found_in(robot, name, sites)
    return mend(structure.trials(robot, values[None]))


def diagnosed(folder: Path, robot: Robot, name: str, sites: tuple[str, ...] | None = None) -> Robot:
    """Saves what a diagnosis would have found.

    Args:
        folder: made.
        robot: from a file.
        name: the effect.
        sites: where; everywhere by default.

    Returns:
        The mended robot.
    """
    structure, values = found_in(robot, name, sites)
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
                "value": float(f"{value:.6g}"),
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
        "joints": [] if kind == "body" else ["*"] if term.shared else list(term.sites),
        **({"bodies": list(term.sites)} if kind == "body" else {}),
        "confidence": 0.9,
        "parameters": parameters,
        "indistinguishable_from": [],
    }
    folder.mkdir(parents=True)
    write_mended(robot, mended, folder / "model.xml")
    content = json.dumps(sidecar({"model.xml": mended}, [effect]))
    (folder / FILE).write_text(content, encoding="utf-8")
    content = json.dumps({"schema": 2, "effects": [effect]})
    (folder / "diagnosis.json").write_text(content, encoding="utf-8")
    return mended
