"""Output of a diagnosis: page, figures, maps, recording."""
