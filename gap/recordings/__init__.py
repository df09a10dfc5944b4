"""Recordings: read, checked, split, and what they say of noise and motion by themselves."""
