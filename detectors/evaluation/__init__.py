"""Studies on simulated fleets: realities that differ from the judge, what they did to it, and the scores."""
