"""The numbers that decide what is named. docs/decision.md says where each comes in.

What is here decides in the comparison. Elsewhere in `search` are numbers by which a search tries
more or less, or a fit ends; these may lose a name but never make one. Three modules have decisions
of their own: whether a timestep is named (`numerical.py`), how targets are read (`holds.py`) and
how wide standard errors are (`certainty.py`). Log odds are natural logarithms.
"""

from __future__ import annotations

from typing import Final

TEMPERATURE: Final = 4.0
"""Differences of elpd are divided by it: blocks are not as independent, and models not as right, as
the densities say. Set on the ground of four real logs; not yet fitted on planted errors."""

TAILS: Final = 4.0
"""Degrees of freedom of the predictive density over blocks: a wild block says little."""

PRICE_RARE: Final = 3.0
"""Log prior odds against an effect that not every model has a little wrong."""

PRICE_PLACE: Final = 0.5
"""And against each joint or body that has an effect, an ordinary one, too."""

PRICE_UNKNOWN: Final = 4.4
"""And against a kind that is not listed, a free effort or what only looks like a name: a quarter as
many causes are of these as of those that are listed and rare."""

LEAST_CHANGE: Final = 0.5
"""What an effect worth a name changes of some channel at least, over its noise and what is left of
the numerical error."""

LEAST_GAIN: Final = 0.05
"""And by how much gaps are smaller with it, as the log of their ratio: in the mean of the channels,
or twice as much at some joint."""

KNOWN: Final = 2.0
"""Standard errors between a number and where it changes nothing, from which on it is known."""

CONFUSION: Final = 0.95
"""The part of the weight that the structures hold among which exchanges are looked for."""

NUMERICAL_LEFT: Final = 0.25
"""What half the timestep changes is taken out of every prediction as far as the recordings tell how
much of it there is. This part of it still counts as noise."""
