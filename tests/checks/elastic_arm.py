"""The rig that the logs of these tests are written for."""

RIG = """[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = 0.05
damping = 0.3
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
motor_torque = "tau"
torque_sensor = "sensor"
"""
