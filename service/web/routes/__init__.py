"""HTTP routes, one file per resource; they ask, they answer, and they hold no SQL."""
