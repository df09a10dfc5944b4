"""What runs in environments of other trainers, each a script with no import of this project."""
