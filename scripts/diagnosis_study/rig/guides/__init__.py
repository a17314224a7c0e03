"""A rig of another make: a cable without mass through guides, see `README.md`."""
