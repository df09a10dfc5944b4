"""The robot, variants of it, and the replay of recordings with them."""
