"""The page about a scene."""
