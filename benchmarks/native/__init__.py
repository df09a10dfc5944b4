"""Robots that are driven by torque, by velocity, along slides and through gears, and their logs."""
