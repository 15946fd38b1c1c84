"""The slow collision certificate on Coal's distances, to which tests hold the referee."""
