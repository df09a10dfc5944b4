"""A log that the model itself has made leaves no gap, whatever drives it, or is refused truly."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.gap.simulation.own_log import gaps, own_log
from walkerkit import gap
from walkerkit.gap.errors import InputError

ELEMENTS = {
    "position": '<position {} kp="20" kv="1"/>',
    "filtered": '<position {} kp="20" kv="1" timeconst="0.03"/>',
    "early": (
        '<general {} dyntype="filterexact" actearly="true" dynprm="0.03" gainprm="20" '
        'biastype="affine" biasprm="0 -20 -1"/>'
    ),
    "within": (
        '<general {} dyntype="filter" actlimited="true" actrange="-1.3 .2" dynprm="0.03" '
        'gainprm="20" biastype="affine" biasprm="0 -20 -1"/>'
    ),
    "velocity": '<velocity {} kv="2"/>',
    "motor": "<motor {}/>",
    "limited": '<position {} kp="20" kv="1" forcerange="-.5 .5" ctrlrange="-.25 .25"/>',
    "offset": '<general {} gainprm="10" biastype="affine" biasprm="0.5 -20 -1"/>',
    "offset_motor": '<general {} gainprm="3" biastype="affine" biasprm="0.1 0 0"/>',
    "offset_velocity": '<general {} gainprm="3" biastype="affine" biasprm="0.3 0 -1.5"/>',
    "cylinder": '<cylinder {} timeconst=".03" area="1"/>',
    "pid": '<pid {} kp="20" kv="1" ki="5"/>',
    "pid of three": '<pid {} kp="20" kv="1" input="pos vel ff"/>',
    "volts": '<dcmotor {} motorconst=".2 .2" resistance=".8"/>',
    "inductive": '<dcmotor {} motorconst=".2 .2" resistance=".8" inductance=".01 0"/>',
    "motor to a position": (
        '<dcmotor {} motorconst=".2 .2" resistance=".8" input="pos" controller="20 0 1"/>'
    ),
    "motor of three": (
        '<dcmotor {} motorconst=".2 .2" resistance=".8" input="pos vel ff" controller="20 3 1"/>'
    ),
    "motor to a speed": (
        '<dcmotor {} motorconst=".2 .2" resistance=".8" input="vel" controller="0 0 1"/>'
    ),
    "motor to an effort": '<dcmotor {} motorconst=".2 .2" resistance=".8" input="ff"/>',
}
REFUSED = {
    "intvelocity": ('<intvelocity {} kp="20" kv="1" actrange="-1 1"/>', "integrates its control"),
    "integrator": ('<general {} dyntype="integrator"/>', "integrates its control"),
    "damper": ('<damper {} kv="1" ctrlrange="0 1"/>', "gain depends on the motion"),
    "muscle": ('<muscle {} lengthrange="-1 1"/>', "is a muscle"),
}
TRANSMISSIONS = {
    "joint": 'joint="a" gear="{}"',
    "jointinparent": 'jointinparent="a" gear="{}"',
    "tendon": 'tendon="t" gear="{}"',
    "site": 'site="s" refsite="r" gear="{} 0 0 0 0 0"',
    "slidercrank": 'cranksite="pin" slidersite="slider" cranklength=".6" gear="{}"',
}
WAYS = (  # gear, delay, integrator
    (1, "", "implicitfast"),
    (-2.5, "", "Euler"),
    (-2.5, 'delay="0.006" nsample="4" interp="zoh"', "implicitfast"),
    (1, 'delay="0.0051" nsample="4" interp="linear"', "Euler"),
    (1, 'delay="0.0051" nsample="4" interp="zoh"', "RK4"),
    (0.5, 'delay="0.0051" nsample="4" interp="linear"', "implicit"),
    (1, "", "RK4"),
)


def arm(actuator, transmission="joint", gear=1.0, delay="", integrator="implicitfast", more=""):
    driven = f'name="act" {TRANSMISSIONS[transmission].format(gear)} {delay}'
    return f"""
    <mujoco>
      <compiler angle="radian"/>
      <option timestep="0.002" integrator="{integrator}"/>
      <worldbody>
        <site name="r"/><site name="slider" pos=".5 0 -.3" zaxis="1 0 0"/>
        <body>
          <joint name="a" axis="0 1 0" damping=".3" armature=".02"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass=".4" contype="0"/>
          <site name="s" pos="0 0 -.3"/><site name="pin" pos="0 0 -.3"/>
          <body pos="0 0 -.25">
            <joint name="b" axis="0 1 0" damping=".3" armature=".02"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".2" contype="0"/>
          </body>
        </body>
      </worldbody>
      <tendon>
        <fixed name="t"><joint joint="a" coef=".7"/><joint joint="b" coef=".4"/></fixed>
      </tendon>
      <actuator>
        <position name="p" joint="b" kp="5" kv=".3"/>
        {actuator.format(driven)}
        {more}
      </actuator>
    </mujoco>"""


def cases():
    """Every element in every transmission, and each pair of these in one of the ways."""
    for e, element in enumerate(ELEMENTS):
        for t, transmission in enumerate(TRANSMISSIONS):
            yield pytest.param(
                element,
                transmission,
                *WAYS[(3 * e + t) % len(WAYS)],
                id=f"{element} {transmission}",
            )


@pytest.mark.parametrize(("element", "transmission", "gear", "delay", "integrator"), [*cases()])
def test_no_gap(element, transmission, gear, delay, integrator):
    xml = arm(ELEMENTS[element], transmission, gear, delay, integrator)
    found = gaps(xml, own_log(mujoco.MjModel.from_xml_string(xml)))
    # The state at the start is known but for what has not settled by then.
    assert max(found.values()) < 1e-4, found


@pytest.mark.parametrize("element", REFUSED)
@pytest.mark.parametrize("transmission", ["joint", "tendon"])
def test_refused_for_what_it_is(element, transmission):
    actuator, reason = REFUSED[element]
    xml = arm(actuator, transmission)
    columns = own_log(mujoco.MjModel.from_xml_string(xml))
    with pytest.raises(InputError, match=rf"the actuator 'act' of own\.xml.*{reason}"):
        gaps(xml, columns)


@pytest.mark.parametrize(
    "more",
    [
        '<velocity name="v" joint="a" kv=".5"/>',
        '<motor name="m" joint="a" gear="3"/>',
        '<position name="p2" joint="a" kp="4"/><motor name="m2" tendon="t"/>',
    ],
    ids=["position and velocity", "position and motor", "two positions and a tendon"],
)
def test_several_actuators_on_one_joint(more):
    xml = arm(ELEMENTS["position"], more=more)
    columns = own_log(mujoco.MjModel.from_xml_string(xml))
    assert max(gaps(xml, columns).values()) < 1e-4


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
@pytest.mark.parametrize("element", ["motor", "volts"])
def test_no_gap_where_replays_restart_in_a_motion(tmp_path, element, integrator):
    xml = arm(ELEMENTS[element], gear=1.5, integrator=integrator).replace("0.002", "0.008")
    columns = own_log(mujoco.MjModel.from_xml_string(xml), rows=250)
    time = columns.pop("time")
    rng = np.random.default_rng(0)
    kept = {
        name: values + 1e-5 * rng.standard_normal(len(time)) * name.endswith("/position")
        for name, values in columns.items()
        if not name.endswith(("/velocity", "/effort"))
    }
    path = tmp_path / "own.xml"
    path.write_text(xml, encoding="utf-8")
    found = gap.compare(path, [gap.Recording(name="own", time=time, columns=kept)])
    assert found.verdict == "no_gap"
    stepped = any("velocities that steps of the model's own length have" in n for n in found.notes)
    assert stepped == (integrator != "RK4")
