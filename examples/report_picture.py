"""Draws docs/report.png: the robot moving in the report of a quadruped with a load on its trunk.

    python examples/report_picture.py [REPORT]

The load was hidden in simulated hardware; its errors are drawn five times as large as they are.
Needs Chromium, and Pillow, which `make` installs for developers.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from _arguments import argument

from walkerkit import gap
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.standing import RATE, standing_targets, write_standing

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "report.png"
LOAD = HiddenEffect(effect="payload", bodies=("trunk",), values={"mass": 3.0})
SHOWN = "#t=1.4&errors=5"
SIZE, COLORS = (960, 1010), 128
FRAME = "border:0;width:100vw;height:100vh"


def report(path: Path) -> gap.Result:
    """Diagnoses the quadruped and writes its report."""
    targets = standing_targets(np.random.default_rng(4), seconds=2.0)
    model = write_standing(path.parent)
    logs = run_hardware(
        model, list(targets.values()), rate=RATE, hidden=[LOAD], seed=5, names=list(targets)
    )
    result = gap.diagnose(model, logs, effects=["payload"])
    result.report(path)
    return result


def browser() -> str:
    """Chromium, or the end of the program with a remedy."""
    found = shutil.which("chromium") or shutil.which("google-chrome")
    if found is None:
        sys.exit("Chromium is not installed. On Debian: apt install chromium")
    return found


def photograph(path: Path, program: str) -> bytes:
    """A window of the browser that shows the report's robot, as PNG."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        drawing = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        quiet = ["--headless", "--no-sandbox", "--no-first-run", "--hide-scrollbars"]
        place = [f"--user-data-dir={folder}/profile", f"--window-size={SIZE[0]},{SIZE[1]}"]
        wait = ["--virtual-time-budget=10000", f"--screenshot={shot}"]
        # A window that is scrolled itself comes out white.
        frame = Path(folder) / "frame.html"
        inside = f"<iframe src='{path.resolve().as_uri()}{SHOWN}' style='{FRAME}'></iframe>"
        frame.write_text(f"<body style='margin:0'>{inside}", encoding="utf-8")
        command = [program, *drawing, *quiet, *place, *wait, frame.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        packed = io.BytesIO()
        picture = Image.open(shot).convert("RGB").quantize(COLORS, dither=Image.Dither.NONE)
        picture.save(packed, format="PNG", optimize=True)
    return packed.getvalue()


def main(path: Path) -> None:
    """Diagnoses, draws and writes."""
    program = browser()
    print(report(path))
    PICTURE.write_bytes(photograph(path, program))
    print(f"{PICTURE.name}: {PICTURE.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main(argument(__doc__, "REPORT", Path("report.html")))
