"""The transient pump: every chamber, compensator, swashplate and circuit over time."""
