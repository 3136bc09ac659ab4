"""The proof that a scene is whole and its hand-off has no hole."""
