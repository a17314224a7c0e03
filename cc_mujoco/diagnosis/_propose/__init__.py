"""Trials that separate what the data cannot."""
