"""Recorded trials: read, in channels of one unit and clock, thinned."""
