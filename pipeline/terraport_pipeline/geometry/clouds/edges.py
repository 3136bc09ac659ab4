"""Where a reconstructed surface ends: at the end of the samples' support and of their footprint.

A Poisson surface runs on beyond its samples. Two rules cut it, both along smooth lines through the
faces (:mod:`~terraport_pipeline.geometry.mesh.clip`), not by taking whole faces away:

1. *Support.* A place is weak where its support ratio passes a threshold read from the histogram
   (:mod:`~terraport_pipeline.geometry.clouds.support`). Connected weak places go if any of them
   passes the larger bound; if none does they are a gap that chance left between samples, and stay.
   (Two thresholds, as edge detectors have them: one alone either riddles thin ground with holes or
   leaves a wide hem.)
2. *Footprint.* What lies outside the cloud's outline, seen from above, goes
   (:mod:`~terraport_pipeline.geometry.clouds.footprint`). It draws the outer border tighter than
   rule 1 can, and says nothing of walls; there rule 1 alone holds.

Everything that depends on the whole cloud is in :class:`EdgeRule`, so that tiles of one surface
are cut alike. ``stages/tiles/joined_tile.py`` applies it to a tile; which weak places stay is
decided over all tiles (``stages/tiles/settle_tiles.py``), since one may reach across a wall.

PURE: no I/O, no clock.

References
----------
J. Canny, "A computational approach to edge detection", IEEE PAMI 8(6), 1986: the two thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from terraport_payload.types import Float64
from terraport_pipeline.geometry.clouds.footprint import Footprint

__all__ = ["EdgeRule"]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeRule:
    """How far a surface goes; one for a whole scene."""

    threshold: float
    """Support ratio above which a place is weak."""
    largest: float
    """Support ratio that no place may pass."""
    spacing_m: float
    """The cloud's areal spacing."""
    footprint: Footprint | None
    """None leaves rule 2 out."""
    outward_m: float = 0.0
    """The surface ends this much farther out than both rules say. For the base, which is thinned
    afterwards: without it the straight pieces of its border would cut off what the detail's border
    rounds, and there would be no base below that."""

    def within(self, low_m: Float64, high_m: Float64) -> Self:
        """Give the rule for vertices in a box, (3,) metres, scene frame: it depends on no more.

        What lies farther inside the outline than any support ratio lets a surface go is all the
        same: a corner of a cell that was cut down lies less than two cells from one that was not.
        """
        if self.footprint is None:
            return self
        most_m = self.largest * self.spacing_m + 2.0 * self.footprint.cell_m
        return replace(self, footprint=self.footprint.within(low_m, high_m, most_m))
