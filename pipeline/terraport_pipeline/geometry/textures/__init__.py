"""Atlases: charts, their packing, baking, gutters and seams."""
