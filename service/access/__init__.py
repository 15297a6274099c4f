"""Who asks, and what is noted of it."""
