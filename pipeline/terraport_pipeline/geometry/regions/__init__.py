"""Ways to cut a surface into regions, and facts about these."""
