"""Named motors, each with the page that its numbers are from.

    MOTORS["unitree_7520_14"].actuator().reflected_inertia  # 0.0101775 kg·m²
    MOTORS["dynamixel_xm430_w350"].actuator(reflected_inertia=0.01)  # the maker states none
    sorted(MOTORS)  # their names

Numbers are as published, for the new motor at the stated voltage; your own motor's spread, wear and
supply are not in them. What is not published is None: nothing here is guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from walkerkit.actuators.motors.electric import ElectricActuator
from walkerkit.actuators.motors.gears import (
    reflected_inertia,
    reflected_inertia_from_two_stage_planetary,
    rpm_to_rad,
)


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor with its gearbox, as published.

    Attributes:
        name: maker and type.
        source: where the numbers are published, and under which conditions.
        velocity_limit: no-load speed at the output [rad/s].
        effort_limit: largest torque at the output [N·m].
        saturation_effort: stall torque at the output [N·m], None where not published.
        rotor_inertia: of the rotor alone, or of the three shafts of a two-stage planetary gearbox,
            each about its own shaft [kg·m²]; None where not published.
        gear_ratio: as many ratios, each from the shaft before [1]; None where not published.

    Raises:
        TypeError: a number is none.
        ValueError: one is out of its bounds, or inertias and ratios do not match.
    """

    name: str
    source: str
    velocity_limit: float
    effort_limit: float
    saturation_effort: float | None = None
    rotor_inertia: tuple[float, ...] | None = None
    gear_ratio: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.rotor_inertia is not None and self.gear_ratio is None:
            raise ValueError(
                f"{self.name!r} has a `rotor_inertia` and no `gear_ratio`: give both, (1,) for a "
                "motor without a gearbox"
            )
        self.actuator(0.0 if self.reflected_inertia is None else None)

    @property
    def reflected_inertia(self) -> float | None:
        """Inertia of rotor and gears at the output [kg·m²], None where not published."""
        if self.rotor_inertia is None or self.gear_ratio is None:
            return None
        if len(self.rotor_inertia) == 1 == len(self.gear_ratio):
            return reflected_inertia(self.rotor_inertia[0], self.gear_ratio[0])
        return reflected_inertia_from_two_stage_planetary(self.rotor_inertia, self.gear_ratio)

    def actuator(self, reflected_inertia: float | None = None) -> ElectricActuator:
        """The numbers that a joint needs.

        Args:
            reflected_inertia: a measured one, in place of the published one [kg·m²].

        Raises:
            ValueError: none is published and none is given.
        """
        inertia = self.reflected_inertia if reflected_inertia is None else reflected_inertia
        if inertia is None:
            raise ValueError(
                f"no rotor inertia is published for {self.name!r}: measure it, for instance by "
                "fitting the joint's armature to a log, and pass `reflected_inertia` [kg·m²]"
            )
        return ElectricActuator(
            reflected_inertia=inertia,
            velocity_limit=self.velocity_limit,
            effort_limit=self.effort_limit,
            saturation_effort=self.saturation_effort,
        )


_G1 = (
    "github.com/mujocolab/mjlab, src/mjlab/asset_zoo/robots/unitree_g1/g1_constants.py; the same "
    "in github.com/unitreerobotics/unitree_rl_mjlab, src/assets/robots/unitree_g1/g1_constants.py"
)
_GO1 = (
    "github.com/unitreerobotics/unitree_ros, robots/go1_description/urdf/go1.urdf (rotor, limits); "
    "gear ratio of github.com/mujocolab/mjlab, "
    "src/mjlab/asset_zoo/robots/unitree_go1/go1_constants.py"
)
_GO1_ROTOR = 0.000111842
# ROBOTIS publishes stall torque and no-load speed, but no torque that can be held: as effort limit
# stands what the servo can briefly give. Its manual advises loads below a fifth of that.
_ROBOTIS = "emanual.robotis.com/docs/en/dxl/x/{}/, at {} V; effort_limit is the stall torque"

_ALL = (
    Motor(
        name="unitree_5020",
        source=_G1,
        velocity_limit=37.0,
        effort_limit=25.0,
        rotor_inertia=(0.139e-4, 0.017e-4, 0.169e-4),
        gear_ratio=(1, 1 + 46 / 18, 1 + 56 / 16),
    ),
    Motor(
        name="unitree_7520_14",
        source=_G1,
        velocity_limit=32.0,
        effort_limit=88.0,
        rotor_inertia=(0.489e-4, 0.098e-4, 0.533e-4),
        gear_ratio=(1, 4.5, 1 + 48 / 22),
    ),
    Motor(
        name="unitree_7520_22",
        source=_G1,
        velocity_limit=20.0,
        effort_limit=139.0,
        rotor_inertia=(0.489e-4, 0.109e-4, 0.738e-4),
        gear_ratio=(1, 4.5, 5),
    ),
    Motor(
        name="unitree_4010",
        source=_G1,
        velocity_limit=22.0,
        effort_limit=5.0,
        rotor_inertia=(0.068e-4, 0.0, 0.0),
        gear_ratio=(1, 5, 5),
    ),
    Motor(
        name="unitree_go1_hip",
        source=_GO1,
        velocity_limit=30.1,
        effort_limit=23.7,
        rotor_inertia=(_GO1_ROTOR,),
        gear_ratio=(6,),
    ),
    Motor(
        name="unitree_go1_knee",
        source=_GO1,
        velocity_limit=20.06,
        effort_limit=35.55,
        rotor_inertia=(_GO1_ROTOR,),
        gear_ratio=(9,),
    ),
    Motor(
        name="anydrive_3",
        source=(
            "github.com/isaac-sim/IsaacLab, "
            "source/isaaclab_assets/isaaclab_assets/robots/anymal.py (ANYmal B, C and D)"
        ),
        velocity_limit=7.5,
        effort_limit=80.0,
        saturation_effort=120.0,
    ),
    Motor(
        name="dynamixel_xl330_m288",
        source=_ROBOTIS.format("xl330-m288", 5.0),
        velocity_limit=rpm_to_rad(103),
        effort_limit=0.52,
        saturation_effort=0.52,
        gear_ratio=(288.4,),
    ),
    Motor(
        name="dynamixel_xm430_w350",
        source=_ROBOTIS.format("xm430-w350", 12.0),
        velocity_limit=rpm_to_rad(46),
        effort_limit=4.1,
        saturation_effort=4.1,
        gear_ratio=(353.5,),
    ),
)


class _Named(dict[str, Motor]):
    def __missing__(self, name: str) -> Motor:
        raise KeyError(f"no motor is called {name!r}: use one of {sorted(self)}, or make a Motor")


MOTORS: Mapping[str, Motor] = MappingProxyType(_Named({motor.name: motor for motor in _ALL}))
