"""What a robot on its feet can be asked to do: motions that were tried in simulation."""
