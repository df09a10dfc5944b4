"""From a log of the real robot to the named effect, added to the model.

    from walkerkit import gap

    d = gap.diagnose("leg.xml", ["a.csv", "b.csv", "c.csv"])
    print(d)                 # verdict, where, what, how sure, the gap before and after
    d.save("out")            # diagnosis.json, report.html, model.xml, actuators.json
    d.model, d.actuators     # the mended model, and what MJCF cannot say
    d.walker()               # both as a composer walker

`gap.diagnose_fleet` does it for many robots and compares them; `gap.compare` measures the gap and
says where it is; `gap.Recording` is a log; `gap.record` runs a simulated robot and returns the log
that a real one would leave; `gap.policy_gap` says which effect breaks a policy. The steps one by
one: `gap.load`, `gap.replay`, `gap.locate`, and `gap.fit` for a structure that is known.
"""

import importlib
from typing import TYPE_CHECKING, Any

from walkerkit.gap.errors import InputError

if TYPE_CHECKING:
    from walkerkit.gap.fitted import Fitted
    from walkerkit.gap.fleet.fleet import Fleet, diagnose_fleet
    from walkerkit.gap.policy.policy_gap import PolicyGap, policy_gap
    from walkerkit.gap.policy.policy_robot import PolicyRobot
    from walkerkit.gap.recorder import record
    from walkerkit.gap.recordings.recording import Recording
    from walkerkit.gap.report.diagnosis import Diagnosis
    from walkerkit.gap.report.result import Result
    from walkerkit.gap.steps import Comparison, fit, load, locate, replay
    from walkerkit.gap.workflow import compare, diagnose

# Loaded on first use: MuJoCo and pandas take longer than a command line should to say --help.
_HOMES = {
    "Comparison": "steps",
    "Diagnosis": "report.diagnosis",
    "Fitted": "fitted",
    "Fleet": "fleet.fleet",
    "PolicyGap": "policy.policy_gap",
    "PolicyRobot": "policy.policy_robot",
    "Recording": "recordings.recording",
    "Result": "report.result",
    "compare": "workflow",
    "diagnose": "workflow",
    "diagnose_fleet": "fleet.fleet",
    "fit": "steps",
    "load": "steps",
    "locate": "steps",
    "policy_gap": "policy.policy_gap",
    "record": "recorder",
    "replay": "steps",
}

__all__ = [
    "Comparison",
    "Diagnosis",
    "Fitted",
    "Fleet",
    "InputError",
    "PolicyGap",
    "PolicyRobot",
    "Recording",
    "Result",
    "compare",
    "diagnose",
    "diagnose_fleet",
    "fit",
    "load",
    "locate",
    "policy_gap",
    "record",
    "replay",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """What the module has by now, and what it has for who asks."""
    return sorted({*globals(), *__all__})
