"""Detection studies: run in parallel and resumable, as a page and as numbers."""
