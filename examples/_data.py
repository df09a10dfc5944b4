"""Where the public logs are that the examples run on."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def folder(name: str) -> Path:
    """The folder of a data set, below WALKERKIT_DATA; ends the program where it is absent."""
    default = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
    path = Path(os.environ.get("WALKERKIT_DATA", default)) / name
    if not path.is_dir():
        sys.exit(f"{path} is missing: set WALKERKIT_DATA to the folder that holds {name}/")
    return path
