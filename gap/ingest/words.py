"""What the names of columns say: of which signal they are, of which joint, or that they are times.

signal_of("/lowstate/motor_state[{}].tau_est")     # "effort"
signal_of("des_dof_pos[{}]")                       # "position_target"
is_time("__time"), is_time("hip/position")         # True, False
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_FIRST = frozenset({"time", "timestamp", "timestamps", "stamp"})
"""Words that make a time of whatever follows, be it of efforts."""
TIMES = frozenset({"time", "timestamp", "timestamps", "stamp", "tick", "ticks", "t", "ts"})
_TARGETS = _words(
    "des desired target targets cmd command commands commanded ref reference goal set setpoint sp "
    "action actions lowcmd trajectory"
)
_KINDS = {
    "position": _words("q pos position positions qpos angle angles theta"),
    "velocity": _words("dq qd vel velocity velocities qvel speed qdot"),
    "effort": _words("tau torque torques effort efforts trq force"),
}
_OTHER = _words(
    "ddq qdd acc accel acceleration accelerations raw error err temperature temp kp kd ki gain "
    "mode lost imu foot odom std min max limit output num id base root contact"
)
_TIME_UNITS = {"ns": "ns", "nsec": "ns", "us": "us", "usec": "us", "ms": "ms", "msec": "ms"}
_TIME_UNITS |= {"s": "s", "sec": "s", "secs": "s", "seconds": "s", "tick": "ms", "ticks": "ms"}


def parts(name: str) -> list[str]:
    """The words of a name, in lower case: of `tauEst` they are tau and est."""
    return [part.lower() for part in _PARTS.findall(name)]


def is_time(name: str) -> bool:
    """Whether a column by this name tells the time."""
    ordered = parts(name)
    words = set(ordered)
    if ordered and ordered[0] in _FIRST:
        return True
    signal = any(words & kind for kind in _KINDS.values())
    return bool(words & TIMES) and not signal


def time_unit(name: str) -> str | None:
    """The unit that the name of a clock tells, or None."""
    return next((_TIME_UNITS[w] for w in reversed(parts(name)) if w in _TIME_UNITS), None)


def signal_of(name: str) -> str | None:
    """The signal that a column by this name is, or None.

    Args:
        name: without the name of the joint, as `/joint_states/{}/position`.
    """
    words = parts(name)
    found = set(words)
    if found & _OTHER:
        return None
    target = "_target" if found & _TARGETS else ""
    # The last word counts: a position controller may be sent velocities.
    for word in reversed(words):
        for kind, names in _KINDS.items():
            if word in names:
                return f"{kind}{target}"
    if target and (found & {"data", "action", "actions"} or _only_targets(words)):
        return "position_target"
    return "position" if words in (["observation", "state"], ["state"]) else None


def _only_targets(words: Sequence[str]) -> bool:
    return all(word in _TARGETS or word in ("dof", "joint", "joints") for word in words)
