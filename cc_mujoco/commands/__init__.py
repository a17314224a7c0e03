"""The commands of `cc-mujoco`, one module each.

A command is a frozen dataclass: its fields are the options, `run` does the work, and
`interrupted` states what an interruption leaves.
"""
