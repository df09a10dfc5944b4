"""The laws of explicit actuators: pure numpy functions over `(..., n_joints)`, and their state."""
