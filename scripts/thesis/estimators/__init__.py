"""Estimators of the thesis, chapter 3, beyond those of `cc_mujoco.estimation`."""
