"""What stands beside zacoustic's gateway in a ROS 2 system."""
