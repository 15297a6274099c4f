"""Flight hours that are left (ISO 13374: prognostics)."""
