"""Stability judged in a process of its own, so that neither its time nor Python's lock is taken from the ticks.

A tire that is not the same all around takes milliseconds to seconds, the longer the slower it turns. A thread that
computed so long would take Python's lock in turn with the ticks, some ten times in each of them.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache
from typing import Any

from ..estimator.vehicle import stability_reply
from ..science.unit import TireWheelUnit
from ..science.wheel import Model

__all__ = ["Analyst", "serve"]

_NICE = 10  # ticks come first
_PROGRAM = "from tire_dynamics.ros.analyst import serve; serve()"


class Analyst:
    """Judges the stability of units, one after the other; called by one thread at a time.

    A uniform unit under given loads, which takes a fraction of a millisecond, is judged at once. The process is made
    when the first one comes that is not, ends with this process whatever ends that, and is made anew where it was ended
    itself.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        self.stability = lru_cache(maxsize=256)(self._stability)
        """``stability(unit, speed, model, n_max, contact)``:
        :func:`~tire_dynamics.estimator.vehicle.stability_reply`, remembered."""

    def _stability(
        self, unit: TireWheelUnit, speed: float, model: Model, n_max: int = 1, contact: bool = False
    ) -> dict[str, Any]:
        if contact or not unit.is_uniform:
            try:
                return self._ask(unit, speed, model, n_max, contact)
            except (OSError, EOFError, pickle.UnpicklingError):
                self._end()
                raise ArithmeticError("the process that computes it has ended") from None
        return stability_reply("", unit, speed, model, n_max, contact)

    def _ask(self, *request: Any) -> dict[str, Any]:
        if self._process is None:
            if self._closed:
                raise EOFError
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for the node, which then closes this
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"},
            )
        assert self._process.stdin is not None and self._process.stdout is not None
        pickle.dump(request, self._process.stdin)
        self._process.stdin.flush()
        found = pickle.load(self._process.stdout)
        if isinstance(found, str):
            raise ArithmeticError(found)
        reply: dict[str, Any] = found
        return reply

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    def close(self) -> None:
        """End the process; who waits for it on another thread hears of that."""
        self._closed = True
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def serve() -> None:
    """Answer requests on standard input until it ends: what the process runs."""
    os.nice(_NICE)
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            found: Any = stability_reply("", *request)
        except (ArithmeticError, ValueError) as error:
            found = str(error)
        with suppress(BrokenPipeError):
            pickle.dump(found, sys.stdout.buffer)
            sys.stdout.buffer.flush()
