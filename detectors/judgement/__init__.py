"""From the evidence between explanations to a verdict (ISO 13374: health assessment)."""
