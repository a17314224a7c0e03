"""Fits of the simulated rig to records, their noise floor and intervals."""
