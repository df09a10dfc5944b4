"""Virtual environments with other packages than ours, made once and kept."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path


def python_with(*packages: str) -> Path:
    """The Python of an environment that has some packages.

    Args:
        packages: as pip takes them, e.g. `mujoco==3.3.7`.

    Returns:
        Its executable; in `WALKERKIT_ENVIRONMENTS`, by default in the user's cache.
    """
    home = os.environ.get("WALKERKIT_ENVIRONMENTS")
    folder = Path(home) if home else Path.home() / ".cache" / "walkerkit" / "environments"
    own = folder / re.sub(r"[^\w.]+", "_", "-".join(packages))
    python = own / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(own)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", *packages], check=True)
    return python


def run_in(python: Path, script: str, *arguments: object) -> str:
    """What a script of this package prints in an environment."""
    path = Path(__file__).with_name(script)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(python), str(path), *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
    )
    if done.returncode:
        raise RuntimeError(f"{script}: {done.stderr.strip()[-2000:]}")
    return done.stdout
