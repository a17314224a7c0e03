"""Verdict on the search, and effects that the data could not show."""
