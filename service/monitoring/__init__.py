"""From a checked record to a stored verdict: acceptance, analysis, the fold over a pump's history."""
