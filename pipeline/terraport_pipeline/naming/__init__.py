"""Regions that people bring or teach: read, put on the ground, and published."""
