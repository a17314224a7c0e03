"""Data without a torque sensor or without the motor's angle."""
