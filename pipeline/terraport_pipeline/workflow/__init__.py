"""The flow of a build: its stages, their results on disk, publication."""
