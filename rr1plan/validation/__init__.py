"""The referee: an independent check of a motion that shares no code with what made it."""

from rr1plan.validation.referee import certify_path, validate

__all__ = ["certify_path", "validate"]
