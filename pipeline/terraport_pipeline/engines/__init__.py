"""Adapters to libraries and file formats: one file each, arrays in and arrays out.

What a library needs, renames or does not promise stays in its file; everything else knows NumPy
arrays only.
"""
