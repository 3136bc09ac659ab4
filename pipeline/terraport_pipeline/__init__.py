"""From a survey to a scene: readers, reconstruction, segmentation, cover, report, validation."""
