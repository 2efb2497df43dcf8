"""The bytes of ROS messages (CDR), encoded and decoded without ROS."""
