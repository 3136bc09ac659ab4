"""What can go wrong in a build, as one tree.

::

    PipelineError
    ├── SurveyError          the input file or its content cannot be used
    │   └── ReadError        the file cannot be read; carries path and place
    │       └── NoPointsError    the file is whole and says itself that it has no points
    ├── MissingReaderError   the file is of a kind whose reader is not installed
    ├── PhotoError           photos or cameras fit neither each other nor the survey
    ├── LabelFileError       a table of labels cannot be used; carries path and line
    ├── PlanError            a drawing of regions, strokes or a model of them cannot be used
    ├── OptionError          an option is out of range or contradicts another
    ├── ResourceError        not enough memory or disk
    ├── EngineError          a child process (Poisson) failed
    ├── StageFailedError     a stage failed in a way that nobody foresaw; carries stage and trace
    ├── BuildLockedError     another build works on the same scene
    └── WorkDirectoryError   the work directory holds something that is not ours or is damaged

Each message says what was received, what was expected and what to do. The command line prints it
after ``error:`` and exits with 1 (2 for :class:`OptionError`).
"""

from __future__ import annotations

from pathlib import Path

__all__ = [
    "BuildLockedError",
    "EngineError",
    "LabelFileError",
    "MissingReaderError",
    "NoPointsError",
    "OptionError",
    "PhotoError",
    "PipelineError",
    "PlanError",
    "ReadError",
    "ResourceError",
    "StageFailedError",
    "SurveyError",
    "WorkDirectoryError",
]


class PipelineError(Exception):
    """Base of every error that the pipeline raises on purpose."""


class SurveyError(PipelineError, ValueError):
    """The survey cannot be used: unreadable, damaged, too small or degenerate."""


class ReadError(SurveyError):
    """A survey file cannot be read.

    Attributes
    ----------
    path : pathlib.Path
        The file.
    reason : str
        What was received and what was expected; lower-case, no full stop.
    advice : str
        What to do about it.
    location : str or None
        Where in the file: ``"byte 1,024"``, ``"point 17"``, ``"line 3"``.
    """

    def __init__(self, path: Path, reason: str, advice: str, location: str | None = None) -> None:
        super().__init__(path, reason, advice, location)
        self.path = path
        self.reason = reason
        self.advice = advice
        self.location = location

    def __str__(self) -> str:
        where = f" at {self.location}" if self.location else ""
        return f"{self.path}{where}: {self.reason}; {self.advice}"


class NoPointsError(ReadError):
    """The file is whole and says itself that it has no points: a tile beside the ground."""


class PhotoError(PipelineError, ValueError):
    """Photos or their cameras cannot be used: missing, damaged, or they look elsewhere."""


class LabelFileError(PipelineError, ValueError):
    """A table of labels cannot be used; no label was changed.

    Attributes
    ----------
    path : pathlib.Path
        The file.
    line : int
        From 1.
    reason : str
        What was received and what was expected; lower-case, no full stop.
    advice : str
        What to do about it.
    """

    def __init__(self, path: Path, line: int, reason: str, advice: str) -> None:
        super().__init__(path, line, reason, advice)
        self.path = path
        self.line = line
        self.reason = reason
        self.advice = advice

    def __str__(self) -> str:
        return f"{self.path} line {self.line}: {self.reason}; {self.advice}"


class MissingReaderError(PipelineError, ImportError):
    """A survey's kind is read by packages of an extra that is not installed.

    No :class:`ReadError`: such a file is whole, and leaving it out as damaged would build half a
    survey.
    """

    def __init__(self, path: Path, kind: str, extra: str) -> None:
        super().__init__(path, kind, extra)
        # `path` is a name that ImportError has for something else.
        self.file, self.kind, self.extra = path, kind, extra

    def __str__(self) -> str:
        return (
            f"{self.file}: {self.kind} is read by packages that are not installed: "
            f"pip install 'terraport[{self.extra}]'"
        )


class PlanError(PipelineError, ValueError):
    """Outlines, strokes or a model of regions cannot be used; the scene is as it was.

    Attributes
    ----------
    path : pathlib.Path or str
        The file.
    reason : str
        What was received and what was expected; lower-case, no full stop.
    advice : str
        What to do about it.
    """

    def __init__(self, path: Path | str, reason: str, advice: str) -> None:
        super().__init__(path, reason, advice)
        self.path = path
        self.reason = reason
        self.advice = advice

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}; {self.advice}"


class OptionError(PipelineError, ValueError):
    """An option is out of range or contradicts another."""


class ResourceError(PipelineError, RuntimeError):
    """The machine has too little memory or disk for what was asked."""


class EngineError(PipelineError, RuntimeError):
    """An external engine failed; the message carries the end of what it printed."""


class StageFailedError(PipelineError, RuntimeError):
    """A stage failed in a way that nobody foresaw: a fault of ours, told without its trace.

    Attributes
    ----------
    stage : str
        What was being done.
    reason : str
        Kind and text of the exception.
    advice : str
        What is kept, and how to go on.
    trace : pathlib.Path or None
        File with the whole trace; None where it could not be written.
    """

    def __init__(self, stage: str, reason: str, advice: str, trace: Path | None) -> None:
        super().__init__(stage, reason, advice, trace)
        self.stage = stage
        self.reason = reason
        self.advice = advice
        self.trace = trace

    def __str__(self) -> str:
        hint = "" if self.trace is None else f" with {self.trace}, which has the whole trace"
        return (
            f"{self.stage} failed in a way that nobody foresaw ({self.reason}); {self.advice}; "
            f"please report it{hint}"
        )


class BuildLockedError(PipelineError, RuntimeError):
    """Another build is working on the same scene."""


class WorkDirectoryError(PipelineError, OSError):
    """The work directory is damaged or holds files that no build of ours wrote."""
