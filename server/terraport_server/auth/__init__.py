"""Who may see what: tokens, their files and keys."""
