"""Actuators: how a command becomes joint effort."""
