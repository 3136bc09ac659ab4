"""Volumes and areas of regions: the highest surface, the toe, and the uncertainty."""
