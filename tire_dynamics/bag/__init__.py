"""rosbag2 bags (Jazzy, mcap storage), written and read with no ROS: a folder of ``.mcap`` and ``metadata.yaml``."""

from .reader import BagReader, Block, Message
from .writer import BagWriter

__all__ = ["BagReader", "BagWriter", "Block", "Message"]
