"""Random robots, of whatever MuJoCo compiles: sizes, options, contacts, limits, drives.

Draws come from a `numpy.random.Generator`, which is many times faster than hypothesis here.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.robot import Excursion
from walkerkit.gap.simulation.wave import Wave

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")
DRIVES = ("position", "velocity", "motor", "general", "intvelocity", "damper", "cylinder", "muscle")
ROBOT = """
<mujoco><compiler angle="radian"/>
<option timestep="{step}" integrator="{integrator}" cone="{cone}" gravity="{gravity}" {override}>
  <flag {flags}/></option>
<default><geom {geom}/></default>
<worldbody>{floor}<body name="trunk" pos="0 0 2">{free}
 <geom type="box" size="{length} {length} {length}" mass="{mass}"/>
 <body name="arm"><joint name="arm" {of_arm}/>
  <geom type="capsule" fromto="0 0 0 0 0 -{length}" size="{radius}" mass="{mass}"/>
  <body name="hand" pos="0 0 -{length}"><joint name="hand" axis="{axis}" {of_hand}/>
    <geom name="hand" size="{radius}" mass="{light}"/></body></body></body></worldbody>
<contact>{pairs}</contact><actuator>{actuators}</actuator></mujoco>
"""
FLOOR = '<geom name="floor" type="plane" size="9 9 1" pos="0 0 -9"/>'


class Draw:
    """Attributes of MJCF.

    Args:
        rng: where they come from.
    """

    def __init__(self, rng):
        self.rng = rng

    def between(self, low, high):
        """A number of any magnitude between two."""
        return float(10 ** self.rng.uniform(np.log10(low), np.log10(high)))

    def signed(self, low, high):
        return self.between(low, high) * float(self.rng.choice([-1, 1]))

    def one(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def maybe(self, text):
        """An attribute, or none; whoever asks has drawn it either way."""
        return self.one("", text)

    def limits(self):
        """Two ends, of which zero need not be between, or may be one."""
        ends = sorted([self.signed(1e-2, 1e2), self.one(0.0, self.signed(1e-2, 1e2))])
        return f"{ends[0]} {ends[1]}"

    def unit(self):
        return self.one(0.0, 0.015, 1.0, float(self.rng.uniform()))

    def solref(self):
        standard = f"{self.between(1e-4, 10)} {self.between(1e-2, 10)}"
        direct = f"{-self.between(1e-2, 1e6)} {-self.one(0.0, self.between(1e-2, 1e4))}"
        return self.one(standard, direct)

    def solimp(self):
        power = self.rng.uniform(1, 6)
        return f"{self.unit()} {self.unit()} {self.between(1e-5, 1)} {self.unit()} {power}"

    def softness(self, ref, imp):
        """Attributes of a constraint, under the names that it has for them."""
        return self.maybe(f'{ref}="{self.solref()}"') + self.maybe(f' {imp}="{self.solimp()}"')

    def geom(self):
        friction = f"{self.one(0.0, self.between(1e-7, 1e2))} {self.between(1e-6, 1)} 1e-4"
        return self.softness("solref", "solimp") + " ".join(
            self.maybe(f' {name}="{value}"')
            for name, value in (
                ("friction", friction),
                ("condim", self.one(1, 3, 4, 6)),
                ("margin", self.between(1e-5, 0.1)),
                ("priority", self.one(-1, 2)),
                ("contype", self.one(0, 2)),
            )
        )

    def joint(self, size):
        numbers = " ".join(
            f'{name}="{size * self.one(0.0, self.between(1e-5, 1e2))}"'
            for name in ("armature", "damping", "frictionloss", "stiffness")
        )
        effort = size * self.between(1e-3, 1e3)
        return " ".join(
            [
                f'type="{self.one("hinge", "slide")}" {numbers}',
                self.maybe(f'range="{self.limits()}" limited="true"'),
                self.maybe(f'actuatorfrcrange="-{effort} {effort}"'),
                self.maybe(f'margin="{self.between(1e-4, 10)}"'),
                self.maybe(f'ref="{self.signed(1e-2, 10)}"'),
                self.maybe(f'springref="{self.signed(1e-2, 10)}"'),
                self.softness("solreflimit", "solimplimit"),
                self.softness("solreffriction", "solimpfriction"),
            ]
        )

    def actuator(self, joint, size):
        kind = self.one(*DRIVES, "position", "motor", "")
        kp, kv = size * self.between(1e-4, 1e5), size * self.between(1e-5, 1e3)
        bias = " ".join(f"{size * self.signed(1e-4, 1e4)}" for _ in range(3))
        low, high = (size * float(end) for end in self.limits().split())
        gains = {
            "": "",
            "position": f'kp="{kp}" kv="{self.one(0.0, kv)}"',
            "velocity": f'kv="{kv}"',
            "motor": "",
            "general": f'gainprm="{kp}" biastype="affine" biasprm="{bias}"',
            "intvelocity": f'kp="{kp}" actrange="-1 1"',
            "damper": f'kv="{kv}" ctrlrange="0 1"',
            "cylinder": "",
            "muscle": 'lengthrange="0 1"',  # which MuJoCo would look for by long simulations
        }
        plain = kind in ("position", "velocity", "motor", "general")
        more = " ".join(
            [
                self.maybe(f'forcerange="{low} {high}" forcelimited="true"'),
                self.maybe(f'ctrlrange="{self.limits()}" ctrllimited="true"'),
                self.maybe('delay="0.02" nsample="10"'),
            ]
        )
        written = f'name="{joint}" joint="{joint}" gear="{self.signed(1e-3, 1e3)}" {gains[kind]}'
        return f"<{kind} {written} {more if plain else ''}/>" if kind else ""

    def robot(self):
        """MJCF of an arm with a hand, mounted or floating, with or without a floor."""
        mass, length = self.between(1e-3, 1e3), self.between(1e-2, 3)
        size = mass * 9.81 * length
        floor = self.maybe(FLOOR)
        pair = f'<pair geom1="floor" geom2="hand" {self.softness("solref", "solimp")}/>'
        return ROBOT.format(
            step=self.between(1e-5, 2e-2),
            integrator=self.one(*INTEGRATORS),
            cone=self.one("pyramidal", "elliptic"),
            gravity=self.one("0 0 -9.81", "0 0 0", "9.81 0 0", "0 1e-9 0"),
            override=self.softness("o_solref", "o_solimp"),
            flags=self.one("", 'override="enable"', 'contact="disable"'),
            geom=self.geom(),
            floor=floor,
            free=self.maybe("<freejoint/>"),
            mass=mass,
            light=mass * self.between(1e-3, 1),
            length=length,
            radius=0.1 * length,
            axis=self.one("1 0 0", "0 0 1", "0.3 -2 0.1"),
            of_arm=self.joint(mass * length**2),
            of_hand=self.joint(mass * length**2),
            pairs=self.maybe(pair) if floor else "",
            actuators=self.actuator("arm", size) + self.actuator("hand", size),
        )

    def excursion(self):
        middle, width = self.rng.uniform(-10, 10), self.between(1e-6, 1e2)
        waves = tuple(
            Wave(
                form=form,
                periods=2 * np.pi / width * self.between(1.25, 400),  # as they are looked for
                amplitude=self.between(1e-7, 1e3),
                phase=self.rng.uniform(-np.pi, np.pi),
            )
            for form in ("pose", "friction", "effort", "position")
            for _ in range(self.rng.integers(3))
        )
        return Excursion(
            lower=middle - width / 2,
            upper=middle + width / 2,
            velocity=self.between(1e-6, 1e3),
            acceleration=self.between(1e-6, 1e5),
            effort=self.between(1e-6, 1e4),
            duration=self.between(1e-1, 1e4),
            prominent=lambda: waves,
        )


def any_robot(seed):
    """A robot whose joints moved somehow, and its MJCF."""
    draw = Draw(np.random.default_rng(seed))
    text = draw.robot()
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "robot.xml")
    return replace(robot, excursions={name: draw.excursion() for name in robot.joints}), text
