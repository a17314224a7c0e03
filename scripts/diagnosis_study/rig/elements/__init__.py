"""A rig of finite elements with contacts that yield gradually, see `README.md`."""
