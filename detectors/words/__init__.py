"""Shapes that all stations hand on: observations, verdicts, thresholds."""
