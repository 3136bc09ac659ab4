"""Streamable segments: regions merged and split within bounds."""
