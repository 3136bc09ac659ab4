"""One client's session: messages and time in, actions out; no I/O and no clock."""
