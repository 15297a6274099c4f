"""What the twin says at a condition, and what is left over."""
