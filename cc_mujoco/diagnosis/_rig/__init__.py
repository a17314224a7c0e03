"""Simulation of the rig along its recorded motions."""
