"""Whether the core is compiled, and what to install if it is not.

setup.py runs this file too, before anything is installed: standard library only. As a command,
``python -m tire_dynamics.build_state`` says it in a line, with exit status 1 where the core runs interpreted.
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import sysconfig
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec

__all__ = ["CORE", "how_to_compile", "is_compiled"]

# The modules that setup.py compiles, all of them or none: compiled modules call one another past Python.
CORE = ("tire_dynamics.science.elementary_core",)

SLOWER = "some 100 times slower"


def is_compiled() -> bool:
    """Whether every module of the core is machine code, and not its source."""
    specs = map(find_spec, CORE)
    return all(spec is not None and str(spec.origin).endswith(tuple(EXTENSION_SUFFIXES)) for spec in specs)


def how_to_compile() -> str:
    """One line for where the core is not compiled: what it costs, what is missing here, and which package brings it.

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
    if "setuptools" in sys.modules and find_spec("Cython") is None:  # while it is built; afterwards nobody needs it
        missing.append("Cython")
        remedies.append("pip install 'Cython>=3.0.8' (or apt install cython3)")
    if missing:
        why, remedy = f"No {' and no '.join(missing)}", f"{', '.join(remedies)}, and install again"
    else:
        why, remedy = "Not compiled when it was installed", "install again, with pip install -v to see why it was not"
    return f"{why}: the core of tire_dynamics runs interpreted, {SLOWER}. To compile it: {remedy}."


if __name__ == "__main__":
    print("The core is compiled" if is_compiled() else how_to_compile())
    sys.exit(not is_compiled())
