"""Tiles of one surface: plan, bands, seams, welding, sums."""
