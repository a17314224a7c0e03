"""Search for the missing effect: replays, fits, folds, search, experiments."""
