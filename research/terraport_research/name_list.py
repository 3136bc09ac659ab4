"""A list of names as one word on the command line."""

from __future__ import annotations

from typing import Final

from terraport_pipeline.option import Notation

__all__ = ["NAMES", "parse_names"]


def parse_names(text: str, what: str) -> tuple[str, ...]:  # noqa: ARG001  any words are names
    """Take words apart at commas; ``none`` is no name."""
    names = tuple(word.strip() for word in text.split(",") if word.strip())
    return () if names == ("none",) else names


NAMES: Final = Notation("NAME,NAME", parse_names, lambda names: ", ".join(names) or "none")
"""How such an option is written and shown."""
