"""Trials that separate effects that the data cannot."""
