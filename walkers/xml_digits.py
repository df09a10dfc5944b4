"""More digits in the XML that MuJoCo writes.

    with xml_digits(17):
        text = spec.to_xml()

MuJoCo writes six, of which a long rollout shows the sixth: gymnasium's ant is 3 cm off after five
seconds. The setting is there for MuJoCo's own tests; a version without it writes its six digits.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator
from pathlib import Path

import mujoco


@contextlib.contextmanager
def xml_digits(digits: int) -> Iterator[None]:
    """Has MuJoCo write numbers with this many digits.

    Args:
        digits: how many; 17 tell every double from every other.
    """
    found = sorted(Path(mujoco.__file__).parent.glob("libmujoco.*"))
    library = ctypes.CDLL(str(found[0])) if found else None
    read = getattr(library, "_mjPRIVATE__get_xml_precision", None)
    write = getattr(library, "_mjPRIVATE__set_xml_precision", None)
    if read is None or write is None:
        yield
        return
    before = read()
    write(digits)
    try:
        yield
    finally:
        write(before)
