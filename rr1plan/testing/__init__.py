"""Tests of motions: assertions for a user's tests, replays of varied arms, verdicts of other collision checkers."""
