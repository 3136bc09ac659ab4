"""The thesis's tables and figures, made again: pages of ``terraport evaluate thesis``."""
