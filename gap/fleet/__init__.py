"""Many robots, each diagnosed on its own, on one machine or many, and compared with each other.

    fleet = gap.diagnose_fleet("fleet.toml", "fleet")
    print(fleet)                # who has which effect, with the parameters side by side

`engine` runs independent jobs on an existing engine, whatever they are.
"""
