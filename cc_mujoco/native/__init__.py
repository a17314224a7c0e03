"""The native core: compiled functions as C99."""
