"""The base of a robot that floats: which columns of a log tell its pose.

    base_columns(log)      # {"base/quaternion_w": "/odom/pose.pose.orientation.w", ...}

Odometry tells the whole pose, an IMU the orientation and the angular velocity alone.
"""

from __future__ import annotations

from walkerkit.gap.ingest.log import Log

_ODOMETRY, _POSE, _IMU = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/Imu",
)
_AXES = "xyz"


def base_columns(log: Log) -> dict[str, str]:
    """Columns of a recording's base to the log's; empty where it has none."""
    for topic, found in log.topics.items():
        head = {_ODOMETRY: f"{topic}/pose.pose", _POSE: f"{topic}/pose"}.get(found.kind)
        if head is not None:
            pose = {f"base/position_{a}": f"{head}.position.{a}" for a in _AXES}
            return pose | {f"base/quaternion_{a}": f"{head}.orientation.{a}" for a in f"w{_AXES}"}
    for topic, found in log.topics.items():
        if found.kind == _IMU:
            turned = {f"base/quaternion_{a}": f"{topic}/orientation.{a}" for a in f"w{_AXES}"}
            return turned | {
                f"base/angular_velocity_{a}": f"{topic}/angular_velocity.{a}" for a in _AXES
            }
    for name in log.columns:
        # Unitree's, real part first.
        if name.endswith("quaternion[0]"):
            head = name.removesuffix("quaternion[0]")
            turned = {
                f"base/quaternion_{a}": f"{head}quaternion[{k}]" for k, a in enumerate("wxyz")
            }
            turned |= {
                f"base/angular_velocity_{a}": f"{head}gyroscope[{k}]" for k, a in enumerate(_AXES)
            }
            return {column: wanted for column, wanted in turned.items() if wanted in log.columns}
    return {}
