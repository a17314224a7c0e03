"""Which effect is missing: replays, fits, folds, search, experiments."""
