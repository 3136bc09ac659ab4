"""``terraport evaluate``: algorithms side by side, on data with truth."""
