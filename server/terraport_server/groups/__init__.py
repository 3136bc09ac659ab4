"""Groups of clients that land together."""
