"""What CI installs is locked, all of it: no new release and no other file gets in unseen."""

from __future__ import annotations

import os
import re
import subprocess
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def needed(name: str, extras: frozenset[str], found: dict[str, str]) -> None:
    """Adds all that an installed distribution needs, with its version."""
    for line in distribution(name).requires or ():
        requirement = Requirement(line)
        marker = requirement.marker
        if marker and not any(marker.evaluate({"extra": extra}) for extra in (extras or {""})):
            continue
        key = canonicalize_name(requirement.name)
        if key in found or key == "walkerkit":
            continue
        try:
            found[key] = distribution(key).version
        except PackageNotFoundError:
            continue  # an extra of this machine lacks it
        needed(key, frozenset(requirement.extras), found)


def locked(repository: Path) -> list[str]:
    """The requirements of the lock file, each with its hashes."""
    text = (repository / "requirements.lock").read_text(encoding="utf-8")
    return re.findall(r"^[^#\s].*\n(?:[ \t].*\n)*", text, re.MULTILINE)


def test_everything_that_is_installed_is_locked(repository: Path) -> None:
    pins = dict(line.split()[0].split("==") for line in locked(repository))
    pinned = {canonicalize_name(name): version for name, version in pins.items()}
    found: dict[str, str] = {}
    every = frozenset(("", "torch", "onnx", "gymnasium", "pybullet", "dev"))
    needed("walkerkit", every, found)
    assert len(found) > 40
    assert canonicalize_name("pip_audit") in pinned
    # What only a build of torch for CUDA needs is not here, nor is torch: see pyproject.toml.
    theirs = re.compile(r"torch|triton|(cuda|nvidia)-.*")
    ours = {name: version for name, version in found.items() if not theirs.fullmatch(name)}
    unpinned = {name for name, version in ours.items() if pinned.get(name) != version}
    assert unpinned == set(), f"`make lock` adds them to requirements.lock: {sorted(unpinned)}"


def test_every_file_has_its_hash(repository: Path) -> None:
    entries = locked(repository)
    assert len(entries) > 100
    without = [entry for entry in entries if not re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry)]
    assert without == []
    makefile = (repository / "Makefile").read_text(encoding="utf-8")
    assert "--no-deps --require-hashes --requirement requirements.lock" in makefile


ANSWER = """\
#!/bin/sh
# What pip-audit prints, where its database answers as `{lock}` says for the lock file.
for file; do :; done
case $file in
  requirements.lock) {lock} ;;
  *) printf 'Name   Version ID            Fix Versions\\njinja2 2.4.1   {known}\\n'; exit 1 ;;
esac
"""


@pytest.mark.parametrize(
    ("known", "lock", "status", "said"),
    [
        ("PYSEC-2014-8  2.7.2", "echo No known vulnerabilities found", 0, "No known vuln"),
        ("PYSEC-2014-8  2.7.2", "echo lxml 6.1.3 PYSEC-2027-1; exit 1", 1, "lxml 6.1.3 PYSEC"),
        ("no answer", "echo No known vulnerabilities found", 0, "by their hashes"),
    ],
    ids=["sound", "hole", "no database"],
)
def test_audit_tells_silence_from_soundness(
    repository: Path, tmp_path: Path, known: str, lock: str, status: int, said: str
) -> None:
    answering = tmp_path / "pip-audit"
    answering.write_text(ANSWER.format(known=known, lock=lock))
    answering.chmod(0o755)
    done = subprocess.run(
        [repository / ".ci" / "audit"],
        env={**os.environ, "PIP_AUDIT": str(answering)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stderr
    assert said in done.stdout
    assert ("No known vulnerabilities" in done.stdout) == (said == "No known vuln")
