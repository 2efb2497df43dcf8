"""The doors: node, bags, command line, figures. The only storey that meets files, clocks and ROS."""
