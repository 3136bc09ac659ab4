"""Options of a build, one module per stage: only these are imported to print help or check words.

PURE: no I/O, no clock. They import no other part of the pipeline but :mod:`.option` and settings.
"""
