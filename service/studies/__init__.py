"""Work for engineers: studies of the twin, of the judge and of files."""
