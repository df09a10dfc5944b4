"""A leg in a file that does all a file can to its numbers."""

# Degrees, classes, frames, unnamed elements, both quotes, an attribute on a line of its own.
AWKWARD = """<?xml version="1.0"?>
<!-- knee > hip -->
<mujoco model='a "leg"'>
  <compiler autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"><flag eulerdamp="enable"/></option>
  <default>
    <joint armature="0.01" damping="0.2"/>
    <default class="leg"><joint range="-80 80" frictionloss='0.05'/>
      <position kp="40" kv="1" forcerange="-9 9"/></default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="thigh" pos="0 0 2" childclass="leg">
      <joint
          name = "hip"
          axis="1 0 0"
      />
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1" contype="0"/>
      <frame pos="0 0 -0.3" euler="0 0 20">
        <body name="shank"><inertial pos="0 0 -0.1" mass="0.5" diaginertia="1e-3 1e-3 1e-4"/>
          <joint name="knee" axis="0 1 0" stiffness="0.3" springref="11"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/></body>
      </frame>
    </body>
  </worldbody>
  <actuator>
    <position class="leg" joint="hip"/><position class="leg" joint="knee" kp="25" ></position>
  </actuator>
  <keyframe><key name="home" qpos="0.1 0.2"/></keyframe>
</mujoco>
"""

# It stands on the floor with a trunk.
STANDING = (
    AWKWARD.replace(
        '<body name="thigh" pos="0 0 2" childclass="leg">',
        '<body name="trunk" pos="0 0 0.52"><freejoint/><geom size="0.1" mass="3" contype="0"/>\n'
        '    <body name="thigh" childclass="leg">',
    )
    .replace("      </frame>\n    </body>", "      </frame>\n    </body></body>")
    .replace('qpos="0.1 0.2"', 'qpos="0 0 0.52 1 0 0 0 0.1 0.2"')
)


def text_for(effect):
    """The leg on which an effect can act."""
    return STANDING if effect == "foot_offset" else AWKWARD
