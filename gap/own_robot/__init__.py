"""What one does with one's own robot before its first log: servos, hanging it up, excitation."""
