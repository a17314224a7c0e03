"""Limits between a judge and the entries that it plays, set by the kernel of Linux.

    hide_memory()              # the judge, before an entry starts
    confine("/tmp/of_entry")   # the process of an entry, before it imports anything

This file runs before the package is imported, as threads that exist keep their rights.
Elsewhere than on Linux nothing is limited.
"""

import contextlib
import ctypes
import glob
import os
import struct
import sys

SET_DUMPABLE, SET_NO_NEW_PRIVS = 4, 38  # of `prctl`
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # system calls of Landlock
WRITE, TRUNCATE = 1 << 1, 1 << 14
CHANGES = (
    (1, WRITE | 0x1FF0),  # write, remove, and make files of any kind
    (2, 1 << 13),  # move them between folders
    (3, TRUNCATE),
)
"""Rights to change files, with the version of Landlock that knows them first."""
TCP, OTHERS = 3, 3
"""Rights to use TCP (version 4), and to signal other processes or to use their abstract
sockets (version 6)."""


def hide_memory() -> None:
    """Keep other processes of the user from reading or tracing this one."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_DUMPABLE, 0, 0, 0, 0)


def confine(folder: str) -> None:
    """Give up all capabilities and, by Landlock, what an entry does not need.

    From now on this process and its children write to accelerators and to files in
    `folder` alone, use no TCP, and signal and trace no process but their own.
    """
    if sys.platform != "linux":
        return
    system = ctypes.CDLL(None)
    system.prctl(SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    with contextlib.suppress(AttributeError):  # not every library has it
        system.capset(struct.pack("=Ii", 0x20080522, 0), bytes(24))
    version = system.syscall(CREATE_RULESET, None, 0, 1)
    if version < 1:
        return  # a kernel without Landlock
    rights = sum(right for first, right in CHANGES if version >= first)
    limits = [rights, TCP if version >= 4 else 0, OTHERS if version >= 6 else 0]
    known = limits[: 1 + (version >= 4) + (version >= 6)]
    rules = struct.pack(f"={len(known)}Q", *known)
    ruleset = system.syscall(CREATE_RULESET, rules, len(rules), 0)
    devices = os.devnull, *glob.glob("/dev/nvidia*"), *glob.glob("/dev/dri/*")
    for place in (folder, *devices):
        allowed = rights if place == folder else rights & (WRITE | TRUNCATE)
        opened = os.open(place, os.O_PATH)
        rule = struct.pack("=Qi", allowed, opened)
        system.syscall(ADD_RULE, ruleset, 1, rule, 0)
        os.close(opened)
    system.syscall(RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)
