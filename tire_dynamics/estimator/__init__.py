"""The estimator storey: wheels through time, fed time stamps. Reads no clock and no file, knows no ROS."""
