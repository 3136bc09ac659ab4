"""The stages of a build, in order: read, clean, reconstruct, segment, pack.

Each module has a ``NAME``, frozen ``Options`` that are checked before any work, and one ``run``.
"""
