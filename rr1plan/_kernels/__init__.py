"""Compiled loops on plain arrays. They trust their input; the Python above them checks it once."""
