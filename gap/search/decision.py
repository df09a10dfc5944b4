"""The numbers that decide what is named. docs/decision.md says where each comes in.

What is here decides; what is elsewhere in `search` (how many rivals are tried, when a fit has
converged) only proposes, and may lose a name but never make one.
"""

from __future__ import annotations

from typing import Final

# Sureness. Differences of elpd are divided by it: blocks are not as independent, and models not as
# right, as the densities say. Fitted on rehearsals and on one half of the errors planted in logs.
TEMPERATURE: Final = 2.0
# Tails of the predictive density over blocks, degrees of freedom: a wild block says little.
TAILS: Final = 4.0
# Log prior odds against an effect, in units of T: an ordinary one at a joint, a rare one, and each
# place of a rare one.
PRICE_ORDINARY: Final = 0.5
PRICE_RARE: Final = 3.0
PRICE_PLACE: Final = 0.5
# And against a free effort: what can follow anything says little by following.
PRICE_UNKNOWN: Final = 8.0
# The smallest gain worth a name: what an effect changes of some channel, over the noise and what
# is left of the numerical error.
LEAST_CHANGE: Final = 0.5
# And by how much the gaps of some joint are smaller with it, as the log of their ratio.
LEAST_GAIN: Final = 0.05
# Standard errors between a number and where it changes nothing, from which on it is known.
KNOWN: Final = 2.0
# The posterior weight from which on an effect is in the mended model and is told as a finding.
FINDING: Final = 0.5
# A confusion set holds as much of the weight of an effect and all that it could be exchanged for.
CONFUSION: Final = 0.95
# What half the timestep changes is taken out of every prediction as far as the recordings tell how
# much of it there is. This part of it still counts as noise.
NUMERICAL_LEFT: Final = 0.25
