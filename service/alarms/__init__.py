"""Alarms in event time: when they are raised, what operators do about them, how they end."""
