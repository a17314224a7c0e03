"""`cc-mujoco plugin`: the engine plugin as a shared library."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro


@dataclass(frozen=True)
class WritePlugin:
    """Write the engine plugin as a shared library that needs no Python."""

    interrupted: ClassVar[str] = "nothing was written"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder to write to."""

    def run(self) -> None:
        """Compile, link and write; print the path of the library.

        Raises:
            CableError: The library cannot be built on this machine or written there.
        """
        from cc_mujoco.export import write_plugin

        print("writing the plugin, about half a minute", file=sys.stderr, flush=True)
        print(write_plugin(self.out))
