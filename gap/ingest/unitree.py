"""What is known of Unitree's messages: their fields, the order of their motors, "no command".

The fields are those of the packages unitree_go (Go2, B2) and unitree_hg (G1, H1-2) of
unitree_ros2; a bag that does not bring its definitions along cannot be read without them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

_IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
_MOTOR_COMMAND = "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\n"
_MOTOR_STATE = "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
_FRAME = (
    "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n"
    "uint16 bandwidth\n"
)

MESSAGES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "unitree_go/msg/IMUState": f"{_IMU}int8 temperature\n",
        "unitree_go/msg/MotorState": (
            f"{_MOTOR_STATE}float32 q_raw\nfloat32 dq_raw\nfloat32 ddq_raw\nint8 temperature\n"
            "uint32 lost\nuint32[2] reserve\n"
        ),
        "unitree_go/msg/MotorCmd": f"{_MOTOR_COMMAND}uint32[3] reserve\n",
        "unitree_go/msg/BmsState": (
            "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\n"
            "uint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol\n"
        ),
        "unitree_go/msg/BmsCmd": "uint8 off\nuint8[3] reserve\n",
        "unitree_go/msg/LowState": (
            f"{_FRAME}unitree_go/IMUState imu_state\nunitree_go/MotorState[20] motor_state\n"
            "unitree_go/BmsState bms_state\nint16[4] foot_force\nint16[4] foot_force_est\n"
            "uint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n"
            "int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\n"
            "uint16[4] fan_frequency\nuint32 reserve\nuint32 crc\n"
        ),
        "unitree_go/msg/LowCmd": (
            f"{_FRAME}unitree_go/MotorCmd[20] motor_cmd\nunitree_go/BmsCmd bms_cmd\n"
            "uint8[40] wireless_remote\nuint8[12] led\nuint8[2] fan\nuint8 gpio\nuint32 reserve\n"
            "uint32 crc\n"
        ),
        "unitree_hg/msg/IMUState": f"{_IMU}int16 temperature\n",
        "unitree_hg/msg/MotorState": (
            f"{_MOTOR_STATE}int16[2] temperature\nfloat32 vol\nuint32[2] sensor\n"
            "uint32 motorstate\nuint32[4] reserve\n"
        ),
        "unitree_hg/msg/MotorCmd": f"{_MOTOR_COMMAND}uint32 reserve\n",
        "unitree_hg/msg/LowState": (
            "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\n"
            "unitree_hg/IMUState imu_state\nunitree_hg/MotorState[35] motor_state\n"
            "uint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc\n"
        ),
        "unitree_hg/msg/LowCmd": (
            "uint8 mode_pr\nuint8 mode_machine\nunitree_hg/MotorCmd[35] motor_cmd\n"
            "uint32[4] reserve\nuint32 crc\n"
        ),
    }
)
"""Type to its definition, for bags that were recorded without definitions."""

QUADRUPED_ORDER: Final = tuple(
    (leg, part) for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")
)
"""The motors 0 to 11 of its quadrupeds: legs from the front right on, each from the trunk down."""

NOT_COMMANDED: Final = MappingProxyType({"position": 2.146e9, "velocity": 16000.0})
"""What `q` and `dq` of a command are where the drive is to ignore them (PosStopF, VelStopF)."""

NO_SIGNALS: Final = frozenset(
    {
        *("head", "level_flag", "frame_reserve", "sn", "version", "bandwidth", "reserve", "crc"),
        *("wireless_remote", "bms_state", "bms_cmd", "fan", "fan_frequency", "led", "gpio"),
        *("bit_flag", "adc_reel", "temperature", "temperature_ntc1", "temperature_ntc2", "lost"),
        *("mode", "mode_pr", "mode_machine", "sensor", "motorstate", "foot_force_est"),
        *("ddq", "q_raw", "dq_raw", "ddq_raw"),
    }
)
"""Fields of its messages, twenty times each in some, that nothing here reads."""
