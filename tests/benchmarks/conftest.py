"""The benchmarks are no part of the installation; they are imported from the checkout."""

from __future__ import annotations

import sys
from pathlib import Path

_ROOT = str(Path(__file__).resolve().parents[2])
if _ROOT not in sys.path:
    # Behind everything else, so that no folder of the checkout hides an installed package.
    sys.path.append(_ROOT)
