"""What a motion looks like: replay in MuJoCo, the 3-D page, pictures of the configuration space."""
