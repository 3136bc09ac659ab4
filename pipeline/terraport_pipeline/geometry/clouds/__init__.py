"""Clouds of points: spacing, outliers, normals, and where what they support ends."""
