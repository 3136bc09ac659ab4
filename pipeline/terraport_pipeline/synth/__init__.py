"""A procedural open-pit quarry with truth: the project's own test bed."""
