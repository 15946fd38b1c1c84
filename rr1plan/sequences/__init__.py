"""Sequences: free motions, straight lines, grasps and pauses, planned together as one motion on one clock."""
