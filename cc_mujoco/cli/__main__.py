"""The command `cc-mujoco` as `python -m cc_mujoco.cli`."""

import sys

from cc_mujoco.cli import main

if __name__ == "__main__":
    sys.exit(main())
