"""What a model file may read and build: tricks of a hostile one are refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.simulation.load_robot import load_robot

BODY = """<worldbody><body>
  <joint name="knee"/><geom {geom}/>{more}
</body></worldbody>"""
SECRET = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model's folder beside a file that is none of its business."""
    (tmp_path / "secret.obj").write_text(SECRET)
    (tmp_path / "other.xml").write_text("<mujoco><option timestep='0.001'/></mujoco>")
    here = tmp_path / "robot"
    (here / "meshes").mkdir(parents=True)
    (here / "meshes/part.obj").write_text(SECRET)
    return here


def write(folder: Path, before: str = "", geom: str = "size='1'", more: str = "") -> Path:
    path = folder / "robot.xml"
    path.write_text(f"<mujoco>{before}{BODY.format(geom=geom, more=more)}</mujoco>")
    return path


def mesh(file: str) -> dict[str, str]:
    return {
        "before": f"<asset><mesh name='m' file='{file}'/></asset>",
        "geom": "type='mesh' mesh='m'",
    }


def refused(path: Path, *parts: str) -> None:
    with pytest.raises(InputError) as caught:
        load_robot(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    for part in (str(path), *parts):
        assert part in message


@pytest.mark.parametrize("file", ["meshes/part.obj", "./meshes/../meshes/part.obj"])
def test_files_below_the_model_are_read(folder: Path, file: str) -> None:
    assert load_robot(write(folder, **mesh(file))).model.nmesh == 1


def test_a_model_may_be_a_link_to_where_its_files_are(folder: Path, tmp_path: Path) -> None:
    write(folder, **mesh("meshes/part.obj"))
    linked = tmp_path / "linked"
    linked.mkdir()
    (linked / "robot.xml").symlink_to(folder / "robot.xml")
    (linked / "meshes").symlink_to(folder / "meshes")
    assert load_robot(linked / "robot.xml").model.nmesh == 1


@pytest.mark.parametrize("how", ["dots", "absolute", "meshdir", "link", "include", "model"])
def test_files_elsewhere_are_refused_unless_allowed(folder: Path, tmp_path: Path, how: str) -> None:
    (folder / "link.obj").symlink_to(tmp_path / "secret.obj")
    given = {
        "dots": mesh("../secret.obj"),
        "absolute": mesh(f"{tmp_path}/secret.obj"),
        "meshdir": {**mesh("secret.obj")},
        "link": mesh("link.obj"),
        "include": {"before": "<include file='../other.xml'/>"},
        "model": {"before": "<asset><model name='m' file='../other.xml'/></asset>"},
    }[how]
    if how == "meshdir":
        given["before"] = f"<compiler meshdir='..'/>{given['before']}"
    path = write(folder, **given)
    refused(path, "lies outside of the model's folder", "--allow-outside")
    assert load_robot(path, allow_outside=True).joints


def test_an_included_file_is_looked_at_too(folder: Path) -> None:
    (folder / "part.xml").write_text(
        "<mujoco><asset><mesh name='m' file='../secret.obj'/></asset></mujoco>"
    )
    path = write(folder, "<include file='part.xml'/>")
    with pytest.raises(InputError, match=r"part\.xml: file '\.\./secret\.obj' lies outside"):
        load_robot(path)
    (folder / "part.xml").write_text("<mujoco><include file='part.xml'/></mujoco>")
    with pytest.raises(InputError, match="does not compile"):
        load_robot(path)


@pytest.mark.parametrize(
    "head",
    [
        "<!DOCTYPE a [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>",
        "<!DOCTYPE a [<!ENTITY x 'ha'><!ENTITY y '&x;&x;&x;&x;'>]>",
        "<!doctype a>",
    ],
)
def test_declared_entities_are_refused(folder: Path, head: str) -> None:
    path = write(folder)
    path.write_text(f"<?xml version='1.0'?>\n{head}\n{path.read_text()}")
    refused(path, "line 2", "entities are not read", "Write what")


@pytest.mark.parametrize(
    ("before", "more", "parts"),
    [
        ("<size memory='100T'/>", "", ("`memory`", "100T")),
        ("<size njmax='2000000000'/>", "", ("`njmax`",)),
        ("<size nuser_geom='1000000000'/>", "", ("`nuser_geom`",)),
        ("<custom><numeric name='a' size='1000000000'/></custom>", "", ("`size` of <numeric>",)),
        (
            "<asset><texture name='t' type='2d' builtin='flat' width='99999' height='9'/></asset>",
            "",
            ("`width` of <texture>",),
        ),
        ("<asset><hfield name='h' nrow='1e6' ncol='9' size='1 1 1 1'/></asset>", "", ("`nrow`",)),
        (
            "",
            "<replicate count='1000'><replicate count='1000'><geom size='1'/></replicate>"
            "</replicate>",
            ("`count` of <replicate>", "1000000 copies"),
        ),
    ],
)
def test_what_would_fill_the_memory_is_refused(
    folder: Path, before: str, more: str, parts: tuple[str, ...]
) -> None:
    refused(write(folder, before, more=more), *parts)


def test_a_model_that_is_too_large_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from walkerkit.gap.simulation import model_files

    path = write(folder)
    monkeypatch.setattr(model_files, "_MOST_BYTES", 50)
    refused(path, "more than the 50 that are read")
