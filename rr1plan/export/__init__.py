"""Files of paths, trajectories and motions: JSON, CSV, ROS messages and bags; and robots for other programs."""
