"""The passes of reading a survey, which :mod:`..read_streamed` makes in their order."""
