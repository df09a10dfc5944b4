"""Tasks and excitation experiments."""
