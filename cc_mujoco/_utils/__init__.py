"""Helpers shared by all subpackages: files, units, checks of arguments."""
