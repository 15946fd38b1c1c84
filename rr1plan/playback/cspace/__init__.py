"""Configuration spaces of two joints: computed on a grid, decided by cell decomposition, drawn and shown."""
