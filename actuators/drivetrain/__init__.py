"""What lies between a command and a joint and MuJoCo has no field for."""
