"""Rehearsals on simulated hardware with something hidden in it."""
