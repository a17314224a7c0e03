"""Repaired scene: a verdict's changes of the MJCF, and the check of its motion."""
