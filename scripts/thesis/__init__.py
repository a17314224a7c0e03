"""The experiments of the thesis, chapters 1 to 4, run again; see `reproduce.py`."""
