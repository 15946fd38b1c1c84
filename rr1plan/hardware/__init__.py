"""RR1's control box: its serial frames, the motion law of its firmware, plans of commands, and sending them."""
