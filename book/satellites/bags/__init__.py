"""Recordings and poses as ROS 2 bags, and bags as recordings: `bags`, `reader`."""
