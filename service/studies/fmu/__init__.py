"""Functional mock-up units for other people's simulations: operating point and transient pump, without Python on the target."""
