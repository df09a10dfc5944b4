"""From a log of the real robot to the named effect, added to the model."""
