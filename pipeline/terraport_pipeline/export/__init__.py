"""Hand a scene on to other tools: rasters, meshes, points, lines, in the survey's own CRS."""
