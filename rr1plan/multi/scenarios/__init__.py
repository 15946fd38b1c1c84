"""Seeded problems of many arms."""
