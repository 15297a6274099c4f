"""What holds for a pump: layers, versions, pins."""
