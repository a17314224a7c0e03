"""Kernels fit into the registers of a GPU; Warp's compiler for it needs none.

A kernel that spills registers keeps them on its stack.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

pytest.importorskip("warp")

import warp as wp

from cc_mujoco.warp._kernels import kernels

LIMIT = 224  # most registers of a kernel; a thread has 255
_FRAME_SIZE, _REGISTERS = 0x11, 0x2F
"""Attributes in the section `.nv.info`: words of a symbol and of a value."""


class KernelUse(NamedTuple):
    """Registers and stack that one kernel takes."""

    registers: int  # per thread
    stack: int  # per thread, where registers are spilled [B]


def compiled_use(kernel: wp.Kernel, arch: int) -> KernelUse:
    """Compile a kernel for a GPU; return what it takes."""
    with tempfile.TemporaryDirectory() as folder:
        (cubin,) = wp.compile_aot_module(
            kernel.module, arch=arch, module_dir=folder, use_ptx=False
        )
        return _read(Path(cubin).read_bytes())


def _read(cubin: bytes) -> KernelUse:
    """Return what the kernel in a file of machine code takes."""
    sections = dict(_sections(cubin))
    values = {_REGISTERS: 0, _FRAME_SIZE: 0}
    info, at = sections[".nv.info"], 0
    while at < len(info):
        form, attribute, size = struct.unpack_from("<BBH", info, at)
        at += 4
        if form == 4:  # a value of some bytes follows
            if attribute in values:
                _, value = struct.unpack_from("<II", info, at)
                values[attribute] = max(values[attribute], value)
            at += size
    return KernelUse(values[_REGISTERS], values[_FRAME_SIZE])


def _sections(elf: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the sections of a 64-bit ELF file by name."""
    (start,) = struct.unpack_from("<Q", elf, 40)
    size, count, names = struct.unpack_from("<HHH", elf, 58)
    heads = [struct.unpack_from("<IIQQQQ", elf, start + i * size) for i in range(count)]
    text = heads[names][4]
    for name, _, _, _, offset, length in heads:
        stop = elf.index(b"\0", text + name)
        yield elf[text + name : stop].decode(), elf[offset : offset + length]


@pytest.mark.study
@pytest.mark.parametrize("implicit", [False, True])
def test_a_part_of_a_step_spills_nothing(implicit):
    own = kernels(frozenset(["friction", "load_independent_friction"]), implicit)
    for kernel in (own.fronts, own.graph, own.commit):
        use = compiled_use(kernel, 90)
        assert 32 <= use.registers <= LIMIT
        assert use.stack == 0
