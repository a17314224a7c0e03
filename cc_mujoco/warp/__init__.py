"""Cables in mujoco_warp: many worlds at once, on a GPU or a processor."""
