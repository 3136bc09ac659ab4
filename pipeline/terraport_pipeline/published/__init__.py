"""A published scene read back as meshes and textures, as a client gets it."""
