"""Films the quadruped's trot: an animated GIF.

    MUJOCO_GL=egl python examples/video.py trot.gif

Needs Pillow, and something that renders: a display (MUJOCO_GL=glfw), an EGL driver (egl), which
also renders without a graphics card where Mesa is installed, or Debian's libosmesa6 (osmesa).
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

if "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "glfw" if os.environ.get("DISPLAY") else "egl"

NO_BACKEND = (
    "cannot render with MUJOCO_GL={backend} ({error}): set MUJOCO_GL=egl (EGL driver; Debian: "
    "libegl1), MUJOCO_GL=osmesa (in software; Debian: libosmesa6) or MUJOCO_GL=glfw (a display)"
)


def check_rendering() -> None:
    """Ends the program, with a remedy, where nothing renders."""
    try:
        from dm_control import mjcf

        physics = mjcf.Physics.from_mjcf_model(mjcf.RootElement())
        physics.render(8, 8)
        physics.free()
    except Exception as error:  # every backend and driver has failures of its own
        said = f"{type(error).__name__}: {error}"
        sys.exit(NO_BACKEND.format(backend=os.environ["MUJOCO_GL"], error=said))


def frames(seconds: float, width: int, height: int, every: int) -> list[Any]:
    """Pictures of the trot from the side.

    Args:
        seconds: how long [s].
        width: of a picture [pixels].
        height: of a picture [pixels].
        every: control steps of 20 ms from one picture to the next.

    Returns:
        (height, width, 3) uint8 each.
    """
    from trot import trot

    return [
        environment.physics.render(height, width, camera_id="quadruped/side")
        for i, (environment, _, _) in enumerate(trot(seconds))
        if i % every == 0
    ]


def write_gif(path: Path, pictures: list[Any], duration: float) -> None:
    """Writes an animation.

    Args:
        path: where.
        pictures: (height, width, 3) uint8 each.
        duration: of each picture [s].
    """
    try:
        from PIL import Image
    except ImportError:
        sys.exit("Pillow is not installed: python -m pip install pillow")
    first, *rest = (Image.fromarray(picture) for picture in pictures)
    milliseconds = round(1000 * duration)
    first.save(path, save_all=True, append_images=rest, duration=milliseconds, loop=0)


def main() -> None:
    """Films and writes."""
    parser = argparse.ArgumentParser(prog="video.py", description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("trot.gif"))
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--size", type=int, nargs=2, default=(480, 320), metavar=("W", "H"))
    chosen = parser.parse_args()
    every = 2  # 25 pictures a second; GIF counts in hundredths
    check_rendering()
    pictures = frames(chosen.seconds, *chosen.size, every)
    write_gif(chosen.path, pictures, 0.02 * every)
    print(f"{chosen.path}: {len(pictures)} pictures, {chosen.path.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
