"""What a Dockerfile says, read as far as this project's own goes: stages and their instructions."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Stage", "read_stages"]


@dataclass
class Stage:
    """One stage: its base and its instructions in order."""

    name: str
    base: str
    instructions: list[tuple[str, str]] = field(default_factory=list)

    def last(self, keyword: str) -> str | None:
        """Return the last instruction of a kind; that one holds."""
        texts = [text for word, text in self.instructions if word == keyword]
        return texts[-1] if texts else None

    def words(self, keyword: str) -> list[str]:
        """Return the words of CMD or ENTRYPOINT, which this project writes as JSON."""
        text = self.last(keyword)
        words: list[str] = [] if text is None else json.loads(text)
        return words

    def healthcheck(self) -> list[str]:
        """Return the command of HEALTHCHECK."""
        text = self.last("HEALTHCHECK")
        assert text is not None, f"stage {self.name} has no HEALTHCHECK"
        command: list[str] = json.loads(text.split("CMD", 1)[1])
        return command

    def environment(self, before: dict[str, str]) -> dict[str, str]:
        """Return what ENV sets, with $NAME filled in from before."""
        variables: dict[str, str] = {}
        for word, text in self.instructions:
            if word == "ENV":
                for name, value in re.findall(r"(\w+)=(\S+)", text):
                    variables[name] = re.sub(
                        r"\$(\w+)", lambda m: {**before, **variables}.get(m.group(1), ""), value
                    )
        return variables


def read_stages(path: Path) -> tuple[dict[str, Stage], dict[str, str]]:
    """Return stages by name, and the defaults of the arguments before the first of them."""
    joined = re.sub(r"\\\n", " ", re.sub(r"(?m)^\s*#.*\n", "", path.read_text()))
    arguments: dict[str, str] = {}
    stages: dict[str, Stage] = {}
    current: Stage | None = None
    for line in filter(None, map(str.strip, joined.splitlines())):
        word, _, text = line.partition(" ")
        if word == "ARG" and current is None:
            name, _, default = text.partition("=")
            arguments[name] = default
        elif word == "FROM":
            base, _, name = text.partition(" AS ")
            base = re.sub(r"\$\{(\w+)\}", lambda m: arguments[m.group(1)], base)
            current = stages[name.strip()] = Stage(name.strip(), base.strip())
        else:
            assert current is not None, line
            current.instructions.append((word, re.sub(r"\s+", " ", text.strip())))
    return stages, arguments
