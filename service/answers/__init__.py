"""Shapes of the API's JSON answers, with units: what handlers give, the document describes and the client returns."""
