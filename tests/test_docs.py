"""The site: it builds without a network, has every public name, and its code runs."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import pages
from tests.gap.ingest.bag import write_bag
from walkerkit.gap.effects import CATALOGUE

PACKAGES = ("gap", "actuators", "walkers", "tasks")
# Those whose blocks `test_readme` runs.
ELSEWHERE = {"actuators", "fleet", "gap", "walkers"}
PROSE = {"architecture", "benchmarks", "catalogue", "concepts", "decision", "evidence", "export"}
ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted({path.stem for path in (ROOT / "docs").glob("*.md")} - ELSEWHERE - PROSE)


@pytest.fixture(scope="module")
def site(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` does, where every name of the network is refused."""
    folder = tmp_path_factory.mktemp("site")
    offline = (
        "import socket, runpy, sys\n"
        "def refused(*_, **__): raise OSError('there is no network here')\n"
        "socket.socket.connect = socket.getaddrinfo = refused\n"
        "runpy.run_module('mkdocs', run_name='__main__')\n"
    )
    command = ["build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(
        [sys.executable, "-c", offline, *command],
        cwd=repository,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_the_site_builds_and_asks_the_network_for_nothing(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|link)\b[^>]*(?:src|href)="(https?:[^"]*)"', text)
        assert loaded == [], page


def test_every_effect_has_its_page_and_its_picture(site: Path) -> None:
    pages = "".join(p.read_text(encoding="utf-8") for p in (site / "effects").glob("*.html"))
    for name in CATALOGUE:
        assert f'id="{name}"' in pages
        assert f'src="{name}.svg"' in pages
        assert 5_000 < (site / f"effects/{name}.svg").stat().st_size < 60_000


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_in_the_reference(site: Path, package: str) -> None:
    module = importlib.import_module(f"walkerkit.{package}")
    page = (site / f"reference/{package}.html").read_text(encoding="utf-8")
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        assert hasattr(module, name)
        assert f'id="walkerkit.{package}.{name}"' in page, name


@pytest.mark.parametrize("package", PACKAGES)
def test_what_the_pages_import_is_public(repository: Path, package: str) -> None:
    module = importlib.import_module(f"walkerkit.{package}")
    for page in (repository / "README.md", *(repository / "docs").glob("*.md")):
        text = page.read_text(encoding="utf-8")
        for line in re.findall(rf"from walkerkit\.{package} import (\([^)]*\)|[^\n(]*)", text):
            names = re.findall(r"\b[A-Za-z_]\w*\b", line.replace("# noqa", ""))
            assert set(names) <= set(module.__all__), page


@pytest.mark.parametrize("page", PAGES)
def test_every_block_of_the_pages_runs(repository: Path, tmp_path: Path, page: str) -> None:
    blocks = pages.runnable(repository / f"docs/{page}.md")
    assert blocks
    if page == "recording":
        write_bag(tmp_path / "my_bag")
    pages.run(blocks, tmp_path)


def test_the_changes_begin_with_this_version(repository: Path) -> None:
    """Semantic versions, newest first; the newest that is released is the package's."""
    text = (repository / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\d+)\.(\d+)\.(\d+)$", text, re.MULTILINE)
    project = (repository / "pyproject.toml").read_text(encoding="utf-8")
    assert f'version = "{".".join(versions[0])}"' in project
    numbers = [tuple(map(int, version)) for version in versions]
    assert numbers == sorted(set(numbers), reverse=True)
    assert text.index("## Unreleased") < text.index("## " + ".".join(versions[0]))
