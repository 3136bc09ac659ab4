"""Land with the Python SDK and print the visible ids of each landing, as JSON.

``python land_with_sdk.py SCENE_URL '[[x, y, z, radius_m], ...]'``
"""

from __future__ import annotations

import asyncio
import json
import sys

import terraport


async def main(url: str, places: list[list[float]]) -> None:
    """Land at each place in turn, in one session."""
    async with terraport.connect(url) as session:
        for x, y, z, radius_m in places:
            landing = await session.land((x, y, z), radius_m)
            await landing.ready()
            sys.stdout.write(json.dumps(list(session.visible)) + "\n")


asyncio.run(main(sys.argv[1], json.loads(sys.argv[2])))
