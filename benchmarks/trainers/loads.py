"""Says of each model file whether this MuJoCo reads it: a line of JSON each."""

import json
import sys

import mujoco

for path in sys.argv[1:]:
    try:
        mujoco.MjModel.from_xml_path(path)
        said = ""
    except ValueError as error:
        said = str(error)
    print(json.dumps([path, said]))
