"""Outputs of an episode: its log, metrics, figure, video, page and Rerun recording.

    log = simulate("wrist", "pi", trajectory="sine", duration=8.0, seed=0)
    write_episode("runs/sine", log, load(find_device("wrist")))

The log holds true values, while the controller sees noisy and delayed measurements. All
other outputs are made from the log and the MuJoCo model.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
