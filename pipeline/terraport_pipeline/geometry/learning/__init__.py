"""What ground looks like, and what a forest makes of it."""
