"""The ground of a model whose servos are not the robot's by orders of magnitude."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.gap.search.test_naming import LEG, found, hide, recorded, search
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.workflow import prepare


@pytest.mark.parametrize("softer", [0.02, 100.0])
def test_gains_that_are_off_by_orders_of_magnitude_are_found(tmp_path: Path, softer: float) -> None:
    """Too soft, the leg hangs in its joints; too stiff, its steps follow no target of the log."""
    model, given = tmp_path / "leg.xml", tmp_path / "given.xml"
    model.write_text(LEG)
    gains = {"kp": (30, 20), "kv": (1, 0.5)}
    text = LEG
    for name, values in gains.items():
        for value in values:
            text = text.replace(f'{name}="{value:g}"', f'{name}="{value / softer!r}"')
    given.write_text(text)
    logs = recorded(model, [hide("coulomb_friction", "ankle", frictionloss=0.2)])
    leg = prepare(load_experiments(given, logs), window=0.5, n_threads=1).problem("zero_order")
    told = found(search(leg, "position_gain", "velocity_gain", "coulomb_friction"))
    for k, joint in enumerate(("knee", "ankle")):
        own = {name: values[k] for name, values in gains.items()}
        kp = own["kp"] / softer + told["position_gain"][joint]
        kd = own["kv"] / softer + told["velocity_gain"][joint]
        assert kp == pytest.approx(own["kp"], rel=0.02)
        assert kd == pytest.approx(own["kv"], rel=0.1)
    assert told["coulomb_friction"] == pytest.approx({"ankle": 0.2}, rel=0.1)
