"""The damage identification curve, as data and as a picture."""
