"""A motor with ball screw and carriage in a closed position loop: judged on effort.

    python examples/emps.py [OUT]

The electro-mechanical positioning system of Janot, Gautier and Brunot (2019): fitted on one
recording, held out on another in which known force pulses were added. The loop hides the error of
the position; the effort shows it.

The makers found that friction which differs between the directions fits better than one for both.
In the catalogue that is `asymmetric_friction`; what the diagnosis says of it is printed last.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from _arguments import argument
from _data import folder

from walkerkit import gap
from walkerkit.gap.effects.equivalences import spelled_out

ASYMMETRIC = "asymmetric_friction"


def main(out: Path, effects: Sequence[str] | None = None) -> gap.Result:
    """Diagnoses the recordings, with the whole catalogue or some effects, and writes the result."""
    data = folder("emps")
    result = gap.diagnose(
        data / "emps.xml",
        [data / "identification.csv", data / "pulses.csv"],
        held_out=[data / "pulses.csv"],
        effects=effects,
    )
    result.save(out)
    return result


def relative_effort_error(result: gap.Result) -> tuple[float, float]:
    """RMS effort error over RMS effort of the held-out recording, before and after."""
    measured = next(
        trace.measured
        for trace in result.diagnosis.traces
        if trace.held_out and trace.signal == "effort"
    )
    size = float(np.sqrt(np.mean(measured**2)))
    effort = result.diagnosis.gap.signals["effort"]
    return effort.before / size, effort.after / size


def on_asymmetric_friction(result: gap.Result) -> str:
    """What the diagnosis makes of friction that differs between the directions."""
    named = {effect.effect: effect for effect in result.diagnosis.effects}
    if ASYMMETRIC in named:
        return f"{ASYMMETRIC}: named, {named[ASYMMETRIC].confidence:.0%} sure"
    for pair, reason in spelled_out(ASYMMETRIC).items():
        if named.keys() >= {*pair}:
            mean, bias = (named[n].parameters[0] for n in ("coulomb_friction", "torque_bias"))
            forward, backward = mean.value - bias.value, mean.value + bias.value
            return (
                f"{ASYMMETRIC}: leaves the same log as {' and '.join(pair)}, which are named: "
                f"{forward:.1f} {mean.unit} forward and {backward:.1f} {mean.unit} backward. "
                f"{reason}"
            )
    for one in named.values():
        if ASYMMETRIC in one.indistinguishable_from:
            return f"{ASYMMETRIC}: fits as well as {one.effect}, which is named"
    tried = any(one.effect == ASYMMETRIC for one in result.diagnosis.considered)
    return f"{ASYMMETRIC}: {'tried, and worth less than what is named' if tried else 'not tried'}"


if __name__ == "__main__":
    found = main(argument(__doc__, "OUT", Path("emps-diagnosis")))
    print(found)
    before, after = relative_effort_error(found)
    print(f"relative effort error on pulses.csv: {before:.1%} before, {after:.1%} after")
    print(on_asymmetric_friction(found))
