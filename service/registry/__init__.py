"""What an operator says about its fleet: pumps, aircraft, installations, maintenance, findings."""
