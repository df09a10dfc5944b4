"""What a user takes away: the findings in any other model of the robot, and in other trainers."""

from walkerkit.gap.deliver.apply import Applied, apply
from walkerkit.gap.deliver.export import Exported, export

__all__ = ["Applied", "Exported", "apply", "export"]
