"""Transfer of what acts on a whole tendon to a winch at the end of a cable."""
