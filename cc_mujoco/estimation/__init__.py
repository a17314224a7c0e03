"""What can be learnt of a cable while it runs, or from a recording of it."""
