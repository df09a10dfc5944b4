"""What a user takes away: the findings in any other model of the robot, and in other trainers."""

from walkerkit.gap.deliver.apply import Applied, apply

__all__ = ["Applied", "apply"]
