"""Robots as composer entities, and the lock-step engine that steps many of them."""
