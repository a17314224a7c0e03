"""From measured data to a better model: where simulation errs, why, the repair."""
