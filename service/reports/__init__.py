"""Reports that an operator prints."""
