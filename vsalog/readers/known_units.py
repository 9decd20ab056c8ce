"""The units that ROS message types imply.

Only where the definition of the message is unambiguous: the position in a ``JointState`` may be radians or metres, so
that it has none here.
"""

from __future__ import annotations

_SI = {
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/msg/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/msg/Accel": {"linear": "m/s^2", "angular": "rad/s^2"},
    "geometry_msgs/msg/Pose": {"position": "m"},
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "geometry_msgs/msg/PointStamped": {"point": "m"},
    "geometry_msgs/msg/Inertia": {"m": "kg", "com": "m"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/Illuminance": {"illuminance": "lx"},
    "sensor_msgs/msg/Range": {
        "range": "m",
        "min_range": "m",
        "max_range": "m",
        "field_of_view": "rad",
    },
    "sensor_msgs/msg/BatteryState": {"voltage": "V", "temperature": "degC", "current": "A"},
}


def unit_of(message: str, field: str) -> str | None:
    """Return the unit of a field of a message type, of everything below it too, or None where it is open."""
    return _SI.get(message, {}).get(field)
