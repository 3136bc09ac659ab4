"""Kernels of the compared ways to reconstruct a surface."""
