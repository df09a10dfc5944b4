"""A page in headless Chromium, which draws WebGL in software."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not on PATH")
_WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_QUIET = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--hide-scrollbars"),
    *("--enable-logging=stderr", "--virtual-time-budget=10000"),
)


def browse(
    path: Path,
    *options: str,
    place: str = "",
    webgl: bool = True,
    size: str = "1200,2000",
    shot: Path | None = None,
) -> tuple[str, list[str]]:
    """The document as the browser leaves it, and what it wrote to the console.

    Args:
        path: the page.
        options: more of the browser's.
        place: what follows the page's address, such as `#t=1.5`.
        webgl: whether the browser has it.
        size: of the window.
        shot: a picture to write in place of the document.
    """
    drawing = _WEBGL if webgl else ("--disable-gpu", "--disable-3d-apis")
    folder = f"--user-data-dir={path.parent / 'profile'}"
    command = [str(CHROMIUM), *_QUIET, *drawing, folder, f"--window-size={size}"]
    done = subprocess.run(
        [
            *command,
            *options,
            f"--screenshot={shot}" if shot else "--dump-dom",
            path.as_uri() + place,
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def picture(path: Path, to: Path, place: str, *, size: str) -> None:
    """Writes what a window of that size shows of a place in a page."""
    # A window that is scrolled itself comes out white.
    frame = path.with_name("frame.html")
    style = "border:0;width:100vw;height:100vh"
    frame.write_text(
        f"<body style='margin:0'><iframe src='{path.as_uri()}{place}' style='{style}'></iframe>"
    )
    browse(frame, size=size, shot=to)
