"""The live node and what it is made of; ``play`` and the demonstration. The only room that knows ROS."""
