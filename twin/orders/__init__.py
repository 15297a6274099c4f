"""Lines of the pump's orders in both pressures: response surfaces of the transient pump, and what a burst shows of them."""
