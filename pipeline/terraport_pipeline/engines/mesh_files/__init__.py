"""Meshes of other programs: read as plain arrays, and written with their segments in colour."""
