"""The slow collision certificate on Coal's distances, the reference for tests of the referee."""
