"""Every code block of the README runs, in its order, in one folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from walkerkit.walkers import LEG_XML

_BLOCK = re.compile(r"^```(bash|python|toml|xml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def _blocks(readme: Path) -> list[tuple[str, str]]:
    return _BLOCK.findall(readme.read_text(encoding="utf-8"))


def _runnable(language: str, code: str) -> bool:
    """`make` itself is what runs this test; other languages are shown, not run."""
    return language in ("bash", "python") and not code.startswith(("git clone", "make "))


def test_every_block_runs(repository: Path, tmp_path: Path) -> None:
    blocks = [block for block in _blocks(repository / "README.md") if _runnable(*block)]
    assert len(blocks) >= 4
    # The README goes on with what `make demo` leaves behind; here with shorter recordings.
    left = tmp_path / "walkerkit-demo"
    left.mkdir()
    (left / "leg.xml").write_bytes(Path(LEG_XML).read_bytes())
    hidden = "--hide viscous_friction --seconds 4"
    demo = f"walkerkit simulate walkerkit-demo/leg.xml {hidden} --out walkerkit-demo/recordings"
    for language, code in [("bash", demo), *blocks]:
        _run(language, code, tmp_path)


@pytest.mark.parametrize("page", ["actuators", "fleet", "gap", "walkers"])
def test_every_block_of_the_pages_runs(repository: Path, tmp_path: Path, page: str) -> None:
    blocks = [block for block in _blocks(repository / f"docs/{page}.md") if _runnable(*block)]
    assert blocks
    for language, code in blocks:
        _run(language, code, tmp_path)


def _run(language: str, code: str, folder: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    command = ["bash", "-euo", "pipefail", "-c", code]
    if language == "python":
        command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.fail(f"{code}\nended with {done.returncode}\n{done.stdout}\n{done.stderr}")


def test_names_every_effect_of_the_catalogue(repository: Path) -> None:
    from walkerkit.gap.effects import CATALOGUE

    text = (repository / "README.md").read_text(encoding="utf-8")
    assert [name for name in CATALOGUE if f"`{name}`" not in text] == []
