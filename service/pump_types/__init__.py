"""Parameter sets by name, built in and stored."""
