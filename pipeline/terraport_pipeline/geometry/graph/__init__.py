"""The graph engine: one merge tree over faces."""
