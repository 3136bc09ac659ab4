"""What ``terraport[server]`` alone does: it serves, without the libraries of builds and tiles."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SAMPLE = Path(__file__).resolve().parents[2] / "data"

BUILDS_AND_TILES = (
    "cryptography", "embreex", "fast_simplification", "jinja2", "laspy", "numba", "obstore",
    "OpenSSL", "PIL", "psutil", "pyarrow", "pycolmap", "pye57", "pypcd4", "pyproj", "rasterio",
    "reportlab", "scipy", "shapely", "sklearn", "trimesh",
)  # fmt: skip
"""Imports that other extras bring."""

PROGRAM = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
        return None

sys.meta_path.insert(0, Blocker())

from pathlib import Path
import httpx
import terraport.sync
from terraport_server.background_server import BackgroundServer

with BackgroundServer(Path({scenes!r})) as server:
    scene = server.scene_url("sample_scene")
    with terraport.sync.connect(scene) as session:
        landing = session.land((5.0, 0.0, 3.0), 15.0)
        landing.ready(60.0)
        print("streamed", landing.stats.streamed_bytes > 0)
    print("preview", httpx.get(f"{{scene}}/preview.jpg").status_code)
    answer = httpx.get(f"{{scene}}/tileset.json")
    print("tiles", answer.status_code, answer.json()["error"]["message"])
"""


def test_it_serves_and_streams_and_says_what_tiles_need() -> None:
    program = PROGRAM.format(blocked=set(BUILDS_AND_TILES), scenes=str(SAMPLE))
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines() == [
        "streamed True",
        "preview 200",
        "tiles 501 this service has no 3D Tiles: pip install 'terraport[tiles]' where it runs",
    ]
