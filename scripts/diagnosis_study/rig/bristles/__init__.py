"""The rig of the usual make: massive nodes held by bristles, see `README.md`."""
