"""HTTP endpoints: scenes, payload, viewer, tiles, strokes."""
