"""Clients of the HTTP API, synchronous and asynchronous over one core, typed by the API's own answers.

They need neither the server nor numpy; ``service.client.testing`` has a service in memory for tests of what uses them.
"""

from service.client.asynchronous import AsyncClient
from service.client.requests import API_PREFIX, RefusedError
from service.client.synchronous import Client

__all__ = ["API_PREFIX", "AsyncClient", "Client", "RefusedError"]
