"""The commands of the README's quick starts, typed as a newcomer types them: in a clone, in a fresh environment.

Those that run until Ctrl-C get it when the commands of the next block have ended. What is not fenced as `sh` or
`python` needs a ROS installation, and is left out.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import venv
from pathlib import Path

CLONE = Path(__file__).resolve().parents[1]
TIRES = Path.home() / "tires"
UNTIL_CTRL_C = "tire-dynamics node"
PARTS = ("Beside a ROS 2 stack", "With a CSV file", "With an IMU and wheel speeds alone", "With the paper")


def blocks(heading: str) -> list[tuple[str, str]]:
    """Language and text of the fenced blocks under a heading."""
    readme = (CLONE / "README.md").read_text(encoding="utf-8")
    part = re.search(rf"^### {re.escape(heading)}\n(.*?)(?=^##)", readme, re.MULTILINE | re.DOTALL)
    assert part, f"the README has no heading {heading!r}"
    return re.findall(r"^```(sh|python)\n(.*?)^```$", part[1], re.MULTILINE | re.DOTALL)


def run(language: str, text: str) -> None:
    """Run a block to its end; an error ends this script."""
    command = ["sh", "-exc", text] if language == "sh" else ["python", "-c", text]
    subprocess.run(command, cwd=CLONE, check=True)


def main() -> None:
    """Run every block, in the order of the README."""
    venv.create(TIRES, with_pip=True)
    os.environ["PATH"] = f"{TIRES / 'bin'}{os.pathsep}{os.environ['PATH']}"
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # this machine may not be alone in its network
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    for heading in PARTS:
        print(f"== {heading}", flush=True)
        node = None
        for language, text in blocks(heading):
            lines = text.strip().splitlines()
            if lines[-1].startswith(UNTIL_CTRL_C):
                run("sh", "\n".join(lines[:-1]))
                command = ["sh", "-xc", f"exec {lines[-1]}"]
                node = subprocess.Popen(command, cwd=CLONE, stderr=subprocess.PIPE, text=True)
                for line in node.stderr or ():  # it says when it is there
                    print(line, end="", flush=True)
                    if "active:" in line:
                        break
                else:
                    sys.exit(f"the node ended with status {node.wait()}")
                continue
            run(language, text)
            if node is not None:
                node.send_signal(signal.SIGINT)
                said = node.communicate()[1]
                print(said, end="", flush=True)
                if node.returncode:
                    sys.exit(f"the node ended with status {node.returncode}")
                node = None


if __name__ == "__main__":
    main()
