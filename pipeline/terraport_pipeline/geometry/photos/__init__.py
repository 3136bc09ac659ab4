"""Photos: lenses, what each shows, and which colours which face."""
