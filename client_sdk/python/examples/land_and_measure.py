"""Land, look at each segment as it arrives, and measure what is there.

python land_and_measure.py http://127.0.0.1:8080/scenes/quarry 0 0 0
"""

from __future__ import annotations

import asyncio
import sys

import numpy as np

import terraport


async def main(url: str, position: tuple[float, float, float]) -> None:
    async with terraport.connect(url) as session:
        landing = await session.land(position, radius_m=30)
        area_m2 = 0.0
        async for segment in landing:  # nearest first
            mesh = segment.arrays()
            a, b, c = (mesh.positions[mesh.faces[:, corner]] for corner in range(3))
            area_m2 += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
        stats = landing.stats
        print(f"{len(landing.segments)} segments, {area_m2:,.0f} m2 of surface")
        print(f"ready after {stats.ready_s:.3f} s, {stats.streamed_bytes:,} bytes")


if __name__ == "__main__":
    x, y, z = map(float, sys.argv[2:5])
    asyncio.run(main(sys.argv[1], (x, y, z)))
