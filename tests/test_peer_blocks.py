"""Blocks of the pages that need another project, run verbatim beside it.

`scripts/test_peers NAME` has the project and names it; elsewhere these tests skip.
Blocks that take longer than half an hour by their page do not run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from page_blocks import STUDY, Block, Reader, every_block

PEER = os.environ.get("CC_MUJOCO_PEER", "")
WITH = [b for b in every_block() if b.needs == PEER and b.seconds <= STUDY]


@pytest.mark.skipif(not PEER, reason="scripts/test_peers names a peer")
@pytest.mark.parametrize("block", WITH if PEER else [], ids=lambda block: block.place)
def test_a_block_that_names_a_peer_runs(block: Block, tmp_path: Path) -> None:
    commands = Path(sys.executable).parent
    reader = Reader(tmp_path, commands, commands)
    try:
        reader.run(block)
    finally:
        reader.close()
