"""ROS bags as sessions, and sessions and results as bags; through rosbags, without ROS."""
