"""Vectorised environments for learning: many copies of a task's walker in lock-step.

from walkerkit.tasks.vector import WalkerVectorEnv     # pip install 'walkerkit[gymnasium]'
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from walkerkit.tasks.vector.copies import Copies
    from walkerkit.tasks.vector.vector_environment import WalkerVectorEnv
    from walkerkit.tasks.vector.vector_task import VectorTask

# Gymnasium is an extra, and only the environment needs it.
_HOMES = {"Copies": "copies", "VectorTask": "vector_task", "WalkerVectorEnv": "vector_environment"}

__all__ = ["Copies", "VectorTask", "WalkerVectorEnv"]


def __getattr__(name: str) -> Any:
    """Imports what is asked for when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
