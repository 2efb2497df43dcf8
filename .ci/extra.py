"""Prints what an extra of the package asks for, as installed: pip then brings it without building the package again."""

import re
import sys
from importlib.metadata import requires


def requirements(extra: str) -> list[str]:
    """Those of one extra, with their markers."""
    found = []
    for each in requires("tire_dynamics") or ():
        name, _, marker = each.partition(";")
        if re.search(rf"""extra == ["']{extra}["']""", marker):
            rest = re.sub(rf"""( and )?extra == ["']{extra}["']""", "", marker).strip()
            found.append(f"{name.strip()}; {rest}" if rest else name.strip())
    return found


if __name__ == "__main__":
    named = requirements(sys.argv[1])
    if not named:
        sys.exit(f"no extra {sys.argv[1]!r}")
    print("\n".join(named))
