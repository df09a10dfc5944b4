"""The catalogue as a whole."""

import re
from pathlib import Path

import pytest

from walkerkit.gap.effects import CATALOGUE, Parameter


def test_every_effect_of_the_catalogue_is_under_contract():
    files = Path(__file__).parent.glob("test_*.py")
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    cases = re.findall(r"^    name = \"(\w+)\"$", text, re.MULTILINE)
    assert sorted(cases) == sorted(CATALOGUE)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE)
def test_what_an_effect_extends_or_resembles_is_another_of_the_catalogue(effect):
    others = (*effect.extends, *effect.resembles)
    assert {*others} <= CATALOGUE.keys() - {effect.name}
    assert len({*others}) == len(others)


def test_catalogue_is_listed_in_the_order_of_its_families():
    names = list(CATALOGUE)
    assert names[:2] == ["viscous_friction", "coulomb_friction"]
    assert names.index("armature") < names.index("command_delay") < names.index("base_tilt")
    with pytest.raises(TypeError):
        CATALOGUE["more"] = CATALOGUE["armature"]


@pytest.mark.parametrize(
    "wrong",
    [{"starts": ()}, {"starts": (3.0,)}, {"zero": -1.0}, {"scale": 0.0}, {"lower": 2.0}],
    ids=str,
)
def test_parameters_that_contradict_themselves_are_refused(wrong):
    right = {"name": "x", "unit": "1", "lower": 0.0, "upper": 2.0, "scale": 1.0, "starts": (1.0,)}
    Parameter(**right)
    with pytest.raises(ValueError, match="parameter 'x' contradicts itself"):
        Parameter(**right | wrong)
