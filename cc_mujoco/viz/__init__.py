"""Outputs of an episode: its log, numbers, figure and Rerun recording.

    log = simulate("wrist", "pi", trajectory="sine", duration=8.0, seed=0)
    write_episode("runs/sine", log, load(find_device("wrist")))

The controller sees what the device's sensors measure, noisy and late; the log holds the
truth. It is all that is needed; everything else is made from it and the model.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
