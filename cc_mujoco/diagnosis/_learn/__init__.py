"""Curves learned from the error that no effect explains."""
