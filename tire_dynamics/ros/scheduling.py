"""What the thread that ticks asks of the system's scheduler; no privilege is needed for it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import struct
import sys

__all__ = ["run_in_time"]

_SLACK = 1  # [ns] by which the kernel may end a wait late, to save power; its default is 50 us
_SLICE = 700_000  # [ns] of processor time: more than a tick takes, half of what other threads have on two cores
_CALLS = {"x86_64": 314, "aarch64": 274}  # of sched_setattr(2), which the C library knows from glibc 2.41 on
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")  # size, policy, flags, nice, priority; runtime, deadline and period [ns]
_RESET_ON_FORK = 1


def run_in_time() -> None:
    """Let the calling thread, the process's first, run when its waits are over (Linux; elsewhere nothing happens).

    Its waits end when they are over, not up to 50 us later, and it asks for short time slices. From Linux 6.12 on, a
    thread that wakes and has the shorter slice need not wait until what runs on its core, the log's thread say, has
    used up its own. Its share of the processor is what it was, the threads that it makes have slices as usual, and
    older kernels take no notice.
    """
    with contextlib.suppress(OSError), open("/proc/self/timerslack_ns", "w", encoding="ascii") as file:
        file.write(f"{_SLACK}")
    if sys.platform != "linux" or platform.machine() not in _CALLS:
        return
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER:  # nobody has chosen anything else
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_OTHER, _RESET_ON_FORK, nice, 0, _SLICE, 0, 0)
        ctypes.CDLL(None).syscall(_CALLS[platform.machine()], 0, attributes, 0)
