"""Proposal of trials to distinguish effects that the present data do not."""
