"""The laws once more, one joint at a time in plain Python, to hold the library against."""

from __future__ import annotations


def pd(kp, kd, p, v, e, q, qd):
    """Effort that proportional-derivative control asks for; targets may be None."""
    effort = kd * ((0.0 if v is None else v) - qd)
    if p is not None:
        effort += kp * (p - q)
    return effort + (0.0 if e is None else e)


def clip(x, low, high):
    """The number, or the bound that it is beyond."""
    if x < low:
        return low
    return high if x > high else x


def dc_motor(effort, v, stall, no_load, limit):
    """What a motor makes of an effort at a speed, from its torque-speed line."""
    corner = no_load * (1.0 + limit / stall)
    v = clip(v, -corner, corner)
    high = stall * (1.0 - v / no_load)
    low = stall * (-1.0 - v / no_load)
    if high > limit:
        high = limit
    if low < -limit:
        low = -limit
    return clip(effort, low, high)


def late(history, lag):
    """What was said `lag` steps ago; before the beginning, what was said first."""
    return history[max(len(history) - 1 - lag, 0)]
