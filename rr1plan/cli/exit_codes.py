"""Exit codes of the command line."""

OK = 0
BAD_INPUT = 2
NO_PLAN = 3
INVALID_PLAN = 4
"""An invalid plan, or a failed replay."""
