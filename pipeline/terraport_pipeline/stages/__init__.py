"""The stages of a build, in order: read, clean, reconstruct, segment, texture, pack.

Their options, and what is done once for the scene; what is done tile by tile is in ``tiles``. What
a stage is made of: ``contract.py``.
"""
