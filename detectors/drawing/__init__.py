"""Small pictures that every report draws alike."""
