"""The hand-off: which detail lies over which base face, and what the base gets where it lacks."""
