"""``tire-dynamics`` as where rosdep and colcon have installed it: without the packages that ROS's keys do not bring."""

import sys
from importlib.abc import MetaPathFinder

MISSING = ("mcap", "rosbags", "lz4", "zstandard")


class Blocker(MetaPathFinder):
    """Finds none of them, as if they were not installed."""

    def find_spec(self, name, path=None, target=None):
        """Says so, as Python itself does."""
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def main() -> None:
    """Run the command with the arguments of this one."""
    sys.meta_path.insert(0, Blocker())
    from tire_dynamics.cli.main import main as command

    status = command()
    assert not set(MISSING) & set(sys.modules)
    sys.exit(status)


if __name__ == "__main__":
    main()
