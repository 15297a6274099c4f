"""Work that outlasts a request: durable, resumed after a crash, cancelled between chunks, one result per item."""
