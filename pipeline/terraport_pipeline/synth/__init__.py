"""A procedural open-pit quarry with truth: the project's own test bed."""

from __future__ import annotations

from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.quarry import Quarry, synthesise

__all__ = ["Material", "Quarry", "QuarryOptions", "synthesise"]
