"""Metrics: table of the numbers of an episode or a design, with units and meanings.

    METRICS["rms_torque_error"].compute(log)            # [N m]
    METRICS["rms_torque_error"].better                  # "low"

`play`, what-if studies, the benchmark and their pages choose from this table. A user's
metric is a `Metric`, on the command line given as `MODULE:NAME`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
