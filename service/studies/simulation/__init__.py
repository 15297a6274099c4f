"""Simulate a scenario file into a flight record and a picture."""
