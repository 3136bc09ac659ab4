"""Scenes as a whole: listed, moved, removed, compared."""
