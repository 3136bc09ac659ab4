"""The survey that is worked on: as read, or over a scene with the samples of unchanged ground."""

from __future__ import annotations

from terraport_pipeline.workflow.runner import Runner
from terraport_pipeline.workflow.workdir import StageRecord

__all__ = ["renew_survey"]


def renew_survey(runner: Runner, read: StageRecord) -> StageRecord:
    """Keep the samples of ground that did not change since the scene's last survey."""
    return read
