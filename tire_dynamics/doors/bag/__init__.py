"""rosbag2 bags (Jazzy, mcap storage), written and read with no ROS: a folder of ``.mcap`` and ``metadata.yaml``."""

from .reader import BagReader, Message
from .writer import BagWriter, load_message_definitions

__all__ = ["BagReader", "BagWriter", "Message", "load_message_definitions"]
