"""Metrics: one table of the numbers of an episode or a design, with unit and meaning.

    METRICS["rms_torque_error"].compute(log)            # [N m]
    METRICS["rms_torque_error"].better                  # "low"

`play`, what-ifs, the benchmark and their pages choose from this table. A metric of the
user is a `Metric`, or `MODULE:NAME` of one on the command line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
