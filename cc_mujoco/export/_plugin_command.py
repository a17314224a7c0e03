"""`cc-mujoco plugin`: the engine plugin as a shared library."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cc_mujoco._utils.command_options import Flag


@dataclass(frozen=True)
class WritePlugin:
    """Write the engine plugin as a shared library that needs no Python."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder to write to."""
    source: Flag = False
    """Write C99 and a CMake file instead of a library."""

    def run(self) -> None:
        """Compile and write; print the path."""
        from cc_mujoco.export import write_plugin, write_plugin_source

        if self.source:
            print(write_plugin_source(self.out))
            return
        print("compiling the plugin, about 10 s", file=sys.stderr, flush=True)
        print(write_plugin(self.out))
