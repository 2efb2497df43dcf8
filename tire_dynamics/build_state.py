"""Whether the core is compiled, and what to install if it is not.

setup.py runs this file too, before anything is installed: standard library only. As a command,
``python -m tire_dynamics.build_state`` says it in a line, with exit status 1 where the core runs interpreted.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
import sysconfig
from importlib import metadata
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec

__all__ = ["CORE", "cython_suits", "how_to_compile", "is_compiled"]

# The modules that setup.py compiles, all of them or none: compiled modules call one another past Python.
CORE = (
    "tire_dynamics.science.elementary",
    "tire_dynamics.science.eigensystem",
    "tire_dynamics.science.mode_series",
    "tire_dynamics.estimator.schedule",
    "tire_dynamics.estimator.motion",
    "tire_dynamics.estimator.belt",
    "tire_dynamics.estimator.road_motion",
    "tire_dynamics.estimator.load_kernel",
    "tire_dynamics.estimator.wheels",
    "tire_dynamics.cdr.field_reader",
    "tire_dynamics.replay.stream",
)

CYTHON = (3, 0, 8)  # the oldest that will do: that of Ubuntu 24.04

SLOWER = "some 150 times slower"


def is_compiled() -> bool:
    """Whether every module of the core is machine code, and not its source."""
    specs = map(find_spec, CORE)
    return all(spec is not None and str(spec.origin).endswith(tuple(EXTENSION_SUFFIXES)) for spec in specs)


def cython_suits() -> bool:
    """Whether there is a Cython that compiles the core; once that is done nobody needs it."""
    try:
        version = metadata.version("Cython")
    except metadata.PackageNotFoundError:
        return False
    return tuple(map(int, re.findall(r"\d+", version)[:3])) >= CYTHON


def how_to_compile(building: bool = False) -> str:
    """One line for where the core is not compiled: what it costs, what is missing here, and which package brings it.

    Parameters
    ----------
    building : bool
        Whether this is asked where the core is built, and by the Python that builds it: only there Cython is needed.

    Returns
    -------
    str
        Of this machine as it is now; what was missing when the package was built may be there since.
    """
    missing, remedies = [], []
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "")
    if os.name == "posix" and (not compiler or shutil.which(compiler[0]) is None):
        missing.append("C compiler")
        remedies.append("apt install gcc")
    if not os.path.isfile(os.path.join(sysconfig.get_path("include"), "Python.h")):
        missing.append("Python.h")
        remedies.append("apt install python3-dev")
    if building and not cython_suits():
        oldest = ".".join(map(str, CYTHON))
        missing.append(f"Cython {oldest} or newer")
        remedies.append(f"pip install 'Cython>={oldest}' (Ubuntu 24.04: apt install cython3)")
    if missing:
        why, remedy = f"No {' and no '.join(missing)}", f"{', '.join(remedies)}, and install again"
    else:
        why, remedy = "Not compiled when it was installed", "install again (pip install -v says why it fails)"
        if not cython_suits():  # pip brings it, colcon does not
            remedy += "; for colcon apt install cython3 before"
    return f"{why}: the core of tire_dynamics runs interpreted, {SLOWER}. To compile it: {remedy}."


if __name__ == "__main__":
    print("The core is compiled" if is_compiled() else how_to_compile())
    sys.exit(not is_compiled())
