"""Groups: clients that land together."""
