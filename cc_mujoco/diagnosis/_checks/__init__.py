"""Checks for faults in the data, before anything is inferred from them."""
