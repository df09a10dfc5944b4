"""What others would do with the same logs: `mujoco.sysid`, PACE's and BAM's sets of parameters.

`logs` has the recordings and how they are split, `published` the numbers of the logs' makers,
`structures` the published sets of effects, `mujoco_sysid` the adaptor to MuJoCo's own
identification. All are judged by `gap.replay`.
"""
