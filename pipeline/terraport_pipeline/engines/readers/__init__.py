"""Readers of survey files."""
