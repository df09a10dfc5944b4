"""Mended models in the user's own text."""

import re
from dataclasses import replace
from difflib import unified_diff

import mujoco
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.trainers.legs import SEEN, leg_at, mended_with
from tests.gap.deliver.robots import AWKWARD, text_for
from walkerkit.gap.deliver.markup import Document
from walkerkit.gap.deliver.patch import differences
from walkerkit.gap.deliver.versions import needed
from walkerkit.gap.deliver.written import patched, write_mended
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.trials import Trials


def changed_lines(before, after):
    lines = unified_diff(before.splitlines(), after.splitlines(), n=0)
    return [line for line in lines if re.match(r"[-+](?![-+])", line)]


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_users_file_says_every_effect(name, tmp_path):
    given = text_for(name)
    robot = leg_at(tmp_path / "own" / "leg.xml", given)
    mended = mended_with(robot, name)
    (tmp_path / "out").mkdir()
    written = write_mended(robot, mended, tmp_path / "out" / "model.xml")
    assert written.reason == ""
    loaded = load_robot(tmp_path / "out" / "model.xml")
    assert not differences(loaded.model, mended.model, ignored=("actuator_ctrlspec",))
    text = (tmp_path / "out" / "model.xml").read_text()
    # Without the attributes that were named nothing is left of the difference.
    edits = patched(robot, mended).edits
    assert len(edits) >= bool(changed_lines(given, text))
    assert text.count("<!-- knee > hip -->") == 1
    assert text.startswith(given[: given.index("<option")])


def test_a_diff_shows_the_attribute_alone(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    mended = mended_with(robot, "armature", sites=("knee",))
    write_mended(robot, mended, tmp_path / "model.xml")
    old, new = changed_lines(AWKWARD, (tmp_path / "model.xml").read_text())
    armature = float(mended.model.dof_armature[1])
    assert new[1:] == old[1:].replace('springref="11"', f'springref="11" armature="{armature:.8g}"')


@pytest.mark.parametrize(
    ("name", "tag"),
    [
        ("position_gain", "position"),
        ("velocity_gain", "position"),
        ("torque_constant", "position"),
        ("effort_limit", "position"),
        ("command_delay", "position"),
        ("torque_bias", "general"),
    ],
)
def test_a_servo_stays_what_it_is_where_it_can_say_it(name, tag, tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    write_mended(robot, mended_with(robot, name), tmp_path / "model.xml")
    nodes = [n.tag for n in Document(tmp_path / "model.xml").root.inside("actuator")[0].children]
    assert nodes == [tag, tag]


def test_line_ends_and_marks_stay(tmp_path):
    text = "\ufeff" + AWKWARD.replace('<?xml version="1.0"?>\n', "").replace("\n", "\r\n")
    robot = leg_at(tmp_path / "own" / "leg.xml", text)
    written = write_mended(robot, mended_with(robot, "coulomb_friction"), tmp_path / "model.xml")
    assert written.reason == ""
    new = (tmp_path / "model.xml").read_bytes()
    assert new.startswith("\ufeff".encode())
    assert new.count(b"\r\n") == new.count(b"\n")


INCLUDED = {
    "scene.xml": '<mujoco><include file="parts/leg.xml"/>'
    '<worldbody><light pos="0 0 3"/></worldbody></mujoco>',
    "parts/leg.xml": '<mujoco><compiler angle="radian" meshdir="meshes"/><asset><mesh name="m" '
    'file="m.obj"/></asset><worldbody><body name="leg"><joint name="knee" axis="0 1 0"/>'
    '<geom type="mesh" mesh="m" mass="1"/></body></worldbody>'
    '<include file="parts/drives.xml"/></mujoco>',
    "parts/drives.xml": '<mujoco><actuator><position joint="knee" kp="9" kv="1"/></actuator>'
    "</mujoco>",
    "meshes/m.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
}


def included(folder):
    for name, text in INCLUDED.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return load_robot(folder / "scene.xml")


def test_included_files_and_meshes_keep_their_places(tmp_path):
    robot = included(tmp_path / "own")
    robot = replace(robot, excursions={"knee": SEEN})
    (tmp_path / "o").mkdir()
    mended = mended_with(robot, "position_gain")
    written = write_mended(robot, mended, tmp_path / "o" / "model.xml")
    assert written.reason == ""
    assert (tmp_path / "o" / "model.xml").read_text() == INCLUDED["scene.xml"]
    assert (tmp_path / "o" / "parts" / "leg.xml").read_text() == INCLUDED["parts/leg.xml"]
    assert (tmp_path / "o" / "meshes" / "m.obj").read_text() == INCLUDED["meshes/m.obj"]
    assert 'kp="9"' not in (tmp_path / "o" / "parts" / "drives.xml").read_text()


REPLICATED = """<mujoco><worldbody><replicate count="2" euler="0 0 90"><body name="arm">
<joint name="j" axis="0 1 0"/><geom size="0.1" mass="1" pos="0.3 0 0"/></body></replicate>
</worldbody></mujoco>"""


def test_what_a_file_does_not_write_out_is_written_anew(tmp_path):
    robot = leg_at(tmp_path / "own" / "model.xml", REPLICATED)
    mended = mended_with(robot, "viscous_friction")
    written = write_mended(robot, mended, tmp_path / "model.xml")
    assert "not written out" in written.reason
    assert written.needs == {"model": mujoco.__version__}
    assert not differences(load_robot(tmp_path / "model.xml").model, mended.model)


def test_settings_that_undo_a_change_are_seen(tmp_path):
    text = AWKWARD.replace("<compiler ", '<compiler inertiafromgeom="true" ')
    robot = leg_at(tmp_path / "own" / "leg.xml", text)
    written = write_mended(robot, mended_with(robot, "payload"), tmp_path / "model.xml")
    assert written.reason


def test_versions_are_told_of_what_is_new(tmp_path):
    robot = leg_at(tmp_path / "leg.xml", AWKWARD)
    late = patched(robot, mended_with(robot, "command_delay"))
    assert set(needed(late.edits)) == {"actuator/delay", "actuator/interp", "actuator/nsample"}
    assert set(needed(patched(robot, mended_with(robot, "quadratic_drag")).edits)) == {
        "joint/damping"
    }
    assert not needed(patched(robot, mended_with(robot, "viscous_friction")).edits)


names = st.sampled_from(["joint", "geom", "a", "frictionloss"])
values = st.text(
    st.characters(
        codec="utf-8",
        exclude_characters="<&\r\n\t\x00",
        exclude_categories=["Cs", "Cc", "Cn", "Co"],
    ),
    max_size=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.dictionaries(names, values, max_size=4),
    values,
    st.sampled_from("'\""),
    st.sampled_from([" ", "\n  ", "  "]),
    st.booleans(),
)
def test_only_the_attribute_changes_whatever_is_around_it(
    tmp_path, attributes, new, quote, space, closed
):
    other = "'" if quote == '"' else '"'
    new = new.replace('"', "").replace("'", "").strip()

    def tag(of):
        text = "".join(f"{space}{k} = {quote}{v}{quote}" for k, v in of.items())
        return f"<x{text}/>" if closed else f"<x{text} ></x>"

    own = {k: v.replace(quote, other) for k, v in attributes.items()}
    path = tmp_path / "a.xml"
    path.write_text(f"<mujoco>é<!-- <x a='1'/> -->{tag(own)}<x/></mujoco>", encoding="utf-8")
    document = Document(path)
    node = document.root.children[0]
    document.set(node, "a", new)
    (text,) = document.texts().values()
    if "a" in own:
        assert text.decode() == path.read_text(encoding="utf-8").replace(
            tag(own), tag(own | {"a": new}), 1
        )
    else:
        assert (
            text.decode().replace(f' a="{new}"', "", 1)
            == f"<mujoco>é<!-- <x a='1'/> -->{tag(own)}<x/></mujoco>"
        )


def test_nothing_to_say_changes_nothing(tmp_path):
    robot = leg_at(tmp_path / "own" / "leg.xml", AWKWARD)
    write_mended(robot, mend(Trials(robot, 1)), tmp_path / "model.xml")
    assert (tmp_path / "model.xml").read_text() == AWKWARD
