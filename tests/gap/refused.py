"""Input that is refused in one line."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from walkerkit.gap.errors import InputError


def refused(action: Callable[[], object], *parts: str) -> str:
    """The message of the InputError that `action` raises: one line that has all `parts`."""
    with pytest.raises(InputError) as caught:
        action()
    message = str(caught.value)
    assert len(message.splitlines()) == 1, message
    for part in parts:
        assert part in message
    return message
