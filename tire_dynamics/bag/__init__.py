"""Bags with no ROS: those of any recorder are read; rosbag2's are written (Jazzy, ``.mcap`` and ``metadata.yaml``)."""

from .reader import BagReader, Block, Message
from .writer import BagWriter

__all__ = ["BagReader", "BagWriter", "Block", "Message"]
