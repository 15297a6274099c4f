"""What is known of a pump, now or as it was known then."""
