"""The API's own description: the OpenAPI document with examples and every error body, and a page that shows it."""
