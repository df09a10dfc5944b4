"""What CI installs is pinned, all of it, so that no new release gets in unseen."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

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
        if key in found or key in ("walkerkit", "setuptools"):  # the latter comes with Python
            continue
        try:
            found[key] = distribution(key).version.partition("+")[0]  # a build for this machine
        except PackageNotFoundError:
            continue  # an extra of this machine lacks it
        needed(key, frozenset(requirement.extras), found)


def test_everything_that_is_installed_is_pinned(repository: Path) -> None:
    lines = (repository / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = dict(line.split("==") for line in lines if line.strip())
    pinned = {canonicalize_name(name): version for name, version in pins.items()}
    found: dict[str, str] = {}
    every = frozenset(("", "torch", "onnx", "gymnasium", "pybullet", "dev"))
    needed("walkerkit", every, found)
    assert len(found) > 40
    unpinned = {name for name, version in found.items() if pinned.get(name) != version}
    assert unpinned == set(), f"add them to constraints.txt: {sorted(unpinned)}"
