"""What stages do tile by tile, and how it is joined."""
