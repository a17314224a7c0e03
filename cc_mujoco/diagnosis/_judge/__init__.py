"""Verdict on what was found, and what the data could not have shown."""
