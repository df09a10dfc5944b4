"""The project in `examples/hopper_project`, installed and tested as a package of a user's own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def project(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of it beside `site`, where it is installed."""
    copy = tmp_path_factory.mktemp("own") / "hopper_project"
    unwanted = shutil.ignore_patterns("build", "*.egg-info", "__pycache__", ".*_cache")
    shutil.copytree(repository / "examples/hopper_project", copy, ignore=unwanted)
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet"]
    run(copy, "-m", "pip", "install", *options, "--target", str(copy.parent / "site"), ".")
    return copy


def run(project: Path, *arguments: str) -> str:
    """What Python prints in the project's folder, in a process that has its effect alone."""
    path = [str(project.parent / "site"), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=project,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.returncode, done.stdout + done.stderr
    return done.stdout


def test_its_own_tests_pass(project: Path) -> None:
    assert " passed" in run(project, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist")
