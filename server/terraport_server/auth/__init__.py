"""Authorisation: tokens, signing keys, origins."""
