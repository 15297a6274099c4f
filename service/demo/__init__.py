"""A simulated fleet for a first try: its pumps, their flights, and the truth about them."""
