"""Endpoints beside the stream: scenes, payload, viewer, tiles, strokes."""
