"""Functional mock-up units: the operating point for other people's simulations, without Python on the target."""
