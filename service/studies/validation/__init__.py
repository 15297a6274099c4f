"""Report of the comparisons with published evidence."""
