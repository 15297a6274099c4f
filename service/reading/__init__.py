"""Questions to stored answers; nothing here writes."""
