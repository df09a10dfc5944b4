"""The numbers of every effect hold together on robots of any size, however far they moved."""

from dataclasses import replace

import mujoco
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.robot import Excursion, robot_from_spec
from walkerkit.gap.simulation.wave import Wave

FORMS = ("pose", "friction", "effort", "position")
ROBOT = """
<mujoco><compiler angle="radian"/><option timestep="{step}" integrator="implicitfast"/>
<worldbody><body name="arm"><joint name="arm" {of_joint}/>
  <geom type="capsule" fromto="0 0 0 0 0 -{length}" size="{radius}" mass="{mass}"/>
  <body name="hand" pos="0 0 -{length}"><joint name="hand" axis="1 0 0" {of_hand}/>
    <geom size="{radius}" mass="{mass}"/></body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>
"""


def between(low, high):
    """Numbers of any magnitude between two."""
    return st.floats(np.log10(low), np.log10(high)).map(lambda power: float(10**power))


def maybe(numbers):
    return st.one_of(st.just(0.0), numbers)


@st.composite
def actuators(draw, joint, size):
    kind = draw(st.sampled_from(["position", "velocity", "motor", ""]))
    kp, kv = size * draw(between(0.1, 1e3)), size * draw(maybe(between(1e-3, 30)))
    gain = {
        "position": f'kp="{kp}" kv="{kv}"',
        "velocity": f'kv="{size * draw(between(1e-2, 30))}"',
        "motor": f'gear="{draw(between(1e-2, 1e2))}"',
    }
    limit = draw(maybe(between(1e-2, 1e2)))
    limited = f'forcerange="-{size * limit} {size * limit}"' if limit else ""
    return f'<{kind} name="{joint}" joint="{joint}" {gain[kind]} {limited}/>' if kind else ""


@st.composite
def joints(draw, size):
    turns = draw(st.sampled_from(["hinge", "slide"]))
    numbers = {
        name: size * draw(maybe(between(1e-4, 10)))
        for name in ("armature", "damping", "frictionloss", "stiffness")
    }
    limit = draw(maybe(between(1e-2, 10)))
    limited = f'range="-{limit} {limit}" limited="true"' if limit else ""
    written = " ".join(f'{name}="{value}"' for name, value in numbers.items())
    return f'type="{turns}" {written} {limited}'


@st.composite
def excursions(draw):
    middle, width = draw(st.floats(-10, 10)), draw(between(1e-6, 1e2))
    found = tuple(
        Wave(
            form=form,
            periods=2 * np.pi / width * draw(between(1.25, 400)),  # as they are looked for
            amplitude=draw(between(1e-7, 1e3)),
            phase=draw(st.floats(-np.pi, np.pi)),
        )
        for form in draw(st.lists(st.sampled_from(FORMS), max_size=4))
    )
    return Excursion(
        lower=middle - width / 2,
        upper=middle + width / 2,
        velocity=draw(between(1e-6, 1e3)),
        acceleration=draw(between(1e-6, 1e5)),
        effort=draw(between(1e-6, 1e4)),
        duration=draw(between(1e-1, 1e4)),
        prominent=lambda: found,
    )


@st.composite
def robots(draw):
    mass, length = draw(between(1e-3, 1e3)), draw(between(1e-2, 3))
    size = mass * 9.81 * length
    text = ROBOT.format(
        step=draw(st.sampled_from([1e-3, 2e-3, 5e-3])),
        mass=mass,
        length=length,
        radius=0.1 * length,
        of_joint=draw(joints(mass * length**2)),
        of_hand=draw(joints(mass * length**2)),
        actuators=draw(actuators("arm", size)) + draw(actuators("hand", size)),
    )
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "robot.xml")
    return replace(robot, excursions={name: draw(excursions()) for name in robot.joints})


@settings(max_examples=150)
@given(robots())
def test_starts_lie_within_bounds_on_any_robot(robot):
    for effect in CATALOGUE.values():
        for site in effect.sites(robot, tuple(robot.joints)):
            parameters = effect.parameters(robot, site)  # which refuses what contradicts itself
            assert len({len(p.starts) for p in parameters}) == 1, effect.name
            for p in parameters:
                numbers = [p.zero, p.lower, p.upper, p.scale, *p.starts]
                assert np.isfinite(numbers).all(), (effect.name, p)
            assert any(v != p.zero for p in parameters for v in p.starts), (effect.name, parameters)
