"""The science storey: pure functions on arrays. No clock, no ROS."""
