"""Write what a viewer would draw at one place as a GLB file: base mesh and detail.

python export_glb.py http://127.0.0.1:8080/scenes/quarry 0 0 0 here.glb
"""

from __future__ import annotations

import sys

import terraport


def main(url: str, position: tuple[float, float, float], path: str) -> None:
    with terraport.sync.connect(url) as session:
        landing = session.land(position, radius_m=30)
        segments = landing.ready(timeout_s=120)
        manifest = session.manifest()
        model = terraport.mixed_model(
            session.base(),
            {segment.id: segment.arrays() for segment in segments},
            landing.hidden_faces,
            sink_rim_m=manifest["hand_off"]["deviation_m"],
        )
    size = terraport.write_glb(model, path, step_m=manifest["step_m"])
    print(f"{path}: {len(model.faces):,} triangles, {size:,} bytes")


if __name__ == "__main__":
    x, y, z = map(float, sys.argv[2:5])
    main(sys.argv[1], (x, y, z), sys.argv[5])
