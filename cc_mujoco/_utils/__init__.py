"""Helpers shared by all subpackages: files, units, argument checks, provenance."""
