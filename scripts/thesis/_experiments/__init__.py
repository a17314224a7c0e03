"""One file per experiment of the thesis; `online_*` belong to `online`."""
