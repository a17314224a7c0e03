"""Registers, stack and code of the kernels of cables on a GPU, compiled without one.

    python scripts/benchmarks/check_registers.py
    python scripts/benchmarks/check_registers.py --scenes ankle --terms static_friction

Warp brings NVIDIA's compiler, so no GPU and no toolkit is needed. A kernel that spills
registers keeps them on its stack. Exits with 1 where a kernel does so or takes more
registers than the limit.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import mujoco
import mujoco_warp as mjw
import tyro
import warp as wp

from cc_mujoco.assets import scene_path
from cc_mujoco.warp import attach, without_plugin

LIMIT = 224  # most registers of a kernel; a thread has 255
_FRAME_SIZE, _REGISTERS = 0x11, 0x2F
"""Attributes in the section `.nv.info`: words of a symbol and of a value."""


class KernelUse(NamedTuple):
    """Registers, stack and code that one kernel takes."""

    registers: int  # per thread
    stack: int  # per thread, where registers are spilled [B]
    code: int  # size of its instructions [B]


def main(
    scenes: tuple[str, ...] = ("wrist",),
    terms: tuple[str, ...] = (),
    arch: int = 90,
    limit: int = LIMIT,
) -> None:
    """Print a row for each kernel.

    Args:
        scenes: scenes with cables.
        terms: further terms that the kernels hold, see `attach`.
        arch: compute capability; 90 is that of an H100.
        limit: most registers of a kernel.
    """
    print("| scene | kernel | registers | stack, B | code, kB |")
    print("|---|---|---:|---:|---:|")
    is_over = False
    for scene in scenes:
        spec = mujoco.MjSpec.from_file(str(scene_path(scene)))
        plain = without_plugin(spec).compile()
        m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=1)
        cables = attach(m, d, spec, terms=terms)
        for name, kernel in cables.kernels.items():
            use = compiled_use(kernel, arch)
            is_over |= use.stack > 0 or use.registers > limit
            print(
                f"| {scene} | {name} | {use.registers} | {use.stack} | "
                f"{use.code / 1e3:.0f} |",
                flush=True,
            )
    if is_over:
        raise SystemExit(1)


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
    code = sum(len(part) for name, part in sections.items() if name[:6] == ".text.")
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
    return KernelUse(values[_REGISTERS], values[_FRAME_SIZE], code)


def _sections(elf: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the sections of a 64-bit ELF file by name."""
    (start,) = struct.unpack_from("<Q", elf, 40)
    size, count, names = struct.unpack_from("<HHH", elf, 58)
    heads = [struct.unpack_from("<IIQQQQ", elf, start + i * size) for i in range(count)]
    text = heads[names][4]
    for name, _, _, _, offset, length in heads:
        stop = elf.index(b"\0", text + name)
        yield elf[text + name : stop].decode(), elf[offset : offset + length]


if __name__ == "__main__":
    tyro.cli(main)
