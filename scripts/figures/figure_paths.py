"""Paths at which the scripts of this folder save their figures."""

import argparse
from pathlib import Path

from cc_mujoco._utils.atomic_io import require_own_file
from cc_mujoco.errors import CableError
from cc_mujoco.report._figures import is_ours


def figure_path(text: str) -> Path:
    """Return the path of a figure to save; a `type` of `argparse`.

    Raises:
        argparse.ArgumentTypeError: It is a folder, or a file that `save` did not write.
    """
    path = Path(text)
    try:
        if path.is_dir():
            raise CableError(f"{text or 'an empty path'} is a folder; name a PNG file.")
        require_own_file(path, is_ours)
    except CableError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return path
