"""Simulations of devices: many at once, each with the bits that it has alone.

    fleet = Fleet(exo, devices, (script,))
    run(fleet, controller, trace.keep, measure=measuring.measure)

`batch` has the one batch that vector environments, what-ifs and the benchmark advance,
and the plant that a controller drives; `batched_controller` has one controller for
devices that differ; `rollout` plays an episode on many models, inside MuJoCo's steps
(`compiled_batch`, `compiled_episode`) where task and controller are compiled.
"""
