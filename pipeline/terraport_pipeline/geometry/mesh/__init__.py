"""Triangle meshes: neighbours, measures, blocks, cuts, samples."""
