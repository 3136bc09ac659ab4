"""Walk across a scene in hops, pointing ahead of each, and see what the hops cost.

python walk.py http://127.0.0.1:8080/scenes/quarry
"""

from __future__ import annotations

import asyncio
import sys

import terraport


async def main(url: str) -> None:
    async with terraport.connect(url, cache_bytes=256 << 20) as session:
        bounds = (await session.manifest())["bounds"]
        (x0, y0, z0), (x1, y1, z1) = bounds["min"], bounds["max"]
        for hop in range(5):
            share = (hop + 0.5) / 5
            target = (x0 + share * (x1 - x0), (y0 + y1) / 2, (z0 + z1) / 2)
            ground = await session.pick(target)  # the surface above or below, loaded or not
            if ground is not None:
                target = ground.position
            session.aim(target, radius_m=15)  # what a headset does while the user points
            await asyncio.sleep(0.2)
            landing = await session.land(target, radius_m=15)
            await landing.ready(timeout_s=60)
            stats = landing.stats
            print(
                f"hop {hop}: {len(landing.segments)} segments, "
                f"{stats.streamed_bytes:,} bytes now, {stats.memory_bytes:,} held, "
                f"ready after {1000 * stats.ready_s:.0f} ms"
            )


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
