"""What a sensor can and cannot see, before it is bought."""
