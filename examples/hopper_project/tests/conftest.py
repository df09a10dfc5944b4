import os

# Before anything imports dm_control, which would look for a display.
os.environ.setdefault("MUJOCO_GL", "disable")
