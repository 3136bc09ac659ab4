"""Regions drawn by hand over pieces of real surveys: labels only, no survey data."""
