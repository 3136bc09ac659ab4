// The header tool writes this file; a plain compiler needs nothing of it.
