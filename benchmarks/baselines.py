"""What other methods reach on the logs of real hardware: the same split, the same yardstick.

    python -m benchmarks baselines             # all logs, all methods: most of an hour
    python -m benchmarks baselines --quick     # what is not fitted, and of emps what MuJoCo steps

Every figure is what `gap.replay` leaves on the recordings that are held out:

- the model as given;
- the parameters that the makers published (`rivals.published`), which nothing here fits;
- `mujoco.sysid` with armature, damping and frictionloss of each joint (`rivals.mujoco_sysid`), its
  own optimizer on the same recordings; it needs the extra `mujoco[sysid]`;
- PACE's set of parameters and BAM's six models as structures of our catalogue, fitted by our means
  (`rivals.structures` says where that is approximate: what is compared is the structure, not their
  optimizers or their code);
- `gap.diagnose`, which is told none of these.

xl330 has four models of one servo, and every method one set of values for all.
"""

from __future__ import annotations

import numpy as np

from benchmarks import Row
from benchmarks.rivals.logs import LOGS
from benchmarks.rivals.methods import GIVEN, METHODS, PLAIN, PUBLISHED, SYSID, SYSID_PLAIN, methods

_OF_PLAIN_FIT = (PLAIN, SYSID_PLAIN)  # which `benchmarks.plain_fit` compares
_QUICK_LOGS = ("emps",)
_QUICK = (GIVEN, PUBLISHED)
_QUICK_FITS = (SYSID, "PACE", "BAM M1")  # of effects that MuJoCo has itself


def run(*, quick: bool) -> list[Row]:
    """All methods on all logs."""
    rows = []
    for log in LOGS:
        try:
            problem = log.load()
        except FileNotFoundError as missing:
            print(missing, flush=True)
            continue
        chosen: tuple[str, ...] = tuple(name for name in METHODS if name not in _OF_PLAIN_FIT)
        if quick:
            chosen = (*_QUICK, *_QUICK_FITS) if log.name in _QUICK_LOGS else _QUICK
        given = 0.0  # the first of the methods changes nothing
        for reached in methods(log, problem, chosen):
            size = float(np.linalg.norm(reached.figure))
            given = given or size
            notes = (f"{size / given:.0%} of as given", reached.note)
            row = Row(
                what=f"{log.name}: {reached.method}",
                result=f"{log.said(reached.figure)}, {reached.parameters} parameters, "
                f"{reached.seconds:.0f} s",
                reference="; ".join(note for note in notes if note),
            )
            print(f"{row.what:30} {row.result}; {row.reference}", flush=True)
            rows.append(row)
    return rows
