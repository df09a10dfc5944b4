"""Actuators: how a command becomes joint effort."""

from walkerkit.actuators.scaled import add_position_actuator, add_velocity_actuator

__all__ = ["add_position_actuator", "add_velocity_actuator"]
