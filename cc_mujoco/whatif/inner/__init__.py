"""Task, controller and record of an episode inside MuJoCo's own step.

    if recipe := recipe_of(episode_task, laws):
        columns, failed = play(...)

A batch that comes back to Python at every control step spends more time there, and on
fetching every simulation into the cache anew, than on physics. Where task and
controller are known as compiled code, they are called when a step ends, by a plugin of
the designs' models, and a simulation goes through its episode in one go.
"""
