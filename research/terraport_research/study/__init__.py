"""The study: detail frozen between landings against detail that follows the head."""
