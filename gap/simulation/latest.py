"""What takes long to make, made once for all who ask, as long as it is asked for now and then.

robots = Latest(24)
robot = robots.get(key, make)      # makes it where it is not kept
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Made = TypeVar("Made")


class Latest:
    """What was asked for last.

    Args:
        most: that are kept.
    """

    def __init__(self, most: int):
        self._most = most
        self._made: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """What belongs to a key.

        Args:
            key: what it is.
            make: called where it is not kept.
        """
        found: Made = self._made.pop(key) if key in self._made else make()
        while len(self._made) >= self._most:
            self._made.popitem(last=False)
        self._made[key] = found
        return found
