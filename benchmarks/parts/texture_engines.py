"""Other libraries' textures: runs in their own Python, called by textures.py.

    python texture_engines.py pymeshlab|open3d FOLDER

FOLDER holds mesh.npz (vertices, faces), views.npz (rotations, positions, focal, width, height) and
photos/0000.png .. (pinhole). Writes result-NAME.npz: vertices, faces, wedge coordinates (upper left
is 0, 0) and times, and result-NAME.png. PyMeshLab is GPL-3: it is called here, in a process of its
own, and is no part of the product.

PyMeshLab needs OpenGL and Debian's Qt: apt install xvfb xauth libqt5gui5 libgl1-mesa-dri libgl1
libopengl0; run by ``xvfb-run -a`` with QT_QPA_PLATFORM=xcb and
QT_PLUGIN_PATH=/usr/lib/x86_64-linux-gnu/qt5/plugins. Open3D: apt install libusb-1.0-0 libgl1.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

SIDE = 4096
"""Of the one texture that each library makes."""


def main() -> None:
    name, folder = sys.argv[1], Path(sys.argv[2])
    with np.load(folder / "mesh.npz") as mesh, np.load(folder / "views.npz") as views:
        arrays = {key: mesh[key] for key in mesh.files}
        cameras = {key: views[key] for key in views.files}
    start, cpu = time.perf_counter(), time.process_time()
    run = {"pymeshlab": _pymeshlab, "open3d": _open3d}[name]
    vertices, faces, wedges = run(folder, arrays["vertices"], arrays["faces"], cameras)
    np.savez(
        folder / f"result-{name}.npz",
        vertices=vertices,
        faces=faces,
        wedges=wedges.astype(np.float32),
        seconds=time.perf_counter() - start,
        cpu_seconds=time.process_time() - cpu,
    )


def _pymeshlab(folder, vertices, faces, cameras):
    import pymeshlab

    _write_ply(folder / "mesh.ply", vertices, faces)
    _write_project(folder, cameras)
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(folder / "project.mlp"))
    meshes.compute_texcoord_parametrization_and_texture_from_registered_rasters(
        texturesize=SIDE,
        texturename="result-pymeshlab.png",
        colorcorrection=True,
        colorcorrectionfiltersize=1,
        usedistanceweight=True,
        useimgborderweight=True,
        cleanisolatedtriangles=True,
        stretchingallowed=False,
        texturegutter=4,
    )
    mesh = meshes.current_mesh()
    images = mesh.textures()
    image = next(iter(images.values()))
    image.save(str(folder / "result-pymeshlab.png"))
    wedges = np.asarray(mesh.wedge_tex_coord_matrix()).reshape(-1, 3, 2).copy()
    wedges[..., 1] = 1.0 - wedges[..., 1]
    return mesh.vertex_matrix(), mesh.face_matrix(), wedges


def _write_project(folder: Path, cameras) -> None:
    """Write cameras in the form of a MeshLab project file."""
    lines = [
        "<!DOCTYPE MeshLabDocument>",
        "<MeshLabProject>",
        " <MeshGroup>",
        '  <MLMesh label="mesh" filename="mesh.ply"><MLMatrix44>',
        "1 0 0 0 \n0 1 0 0 \n0 0 1 0 \n0 0 0 1 \n</MLMatrix44></MLMesh>",
        " </MeshGroup>",
        " <RasterGroup>",
    ]
    width, height, focal = (int(cameras[k]) for k in ("width", "height", "focal"))
    for number, (rotation, centre) in enumerate(
        zip(cameras["rotations"], cameras["positions"], strict=True)
    ):
        rows = np.eye(4)
        rows[:3, :3] = rotation * np.array([[1.0], [-1.0], [-1.0]])
        turn = " ".join(f"{value:.12g}" for value in rows.ravel())
        away = " ".join(f"{-value:.9f}" for value in centre)
        lines += [
            f'  <MLRaster label="{number:04d}.png">',
            (
                f'   <VCGCamera RotationMatrix="{turn} " TranslationVector="{away} 1" '
                f'FocalMm="{focal}" PixelSizeMm="1 1" ViewportPx="{width} {height}" '
                f'CenterPx="{width // 2} {height // 2}" LensDistortion="0 0" CameraType="0" '
                'BinaryData="0"/>'
            ),
            f'   <Plane semantic="1" fileName="photos/{number:04d}.png"/>',
            "  </MLRaster>",
        ]
    lines += [" </RasterGroup>", "</MeshLabProject>", ""]
    (folder / "project.mlp").write_text("\n".join(lines))


def _write_ply(path: Path, vertices, faces) -> None:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())


def _open3d(folder, vertices, faces, cameras):
    import open3d as o3d

    mesh = o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(faces.astype(np.int64))
    )
    mesh.compute_uvatlas(size=SIDE, gutter=4.0, parallel_partitions=2, nthreads=2)
    wedges = mesh.triangle["texture_uvs"].numpy().copy()
    images, inside, outside = [], [], []
    width, height = int(cameras["width"]), int(cameras["height"])
    focal = float(cameras["focal"])
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    for number, (rotation, centre) in enumerate(
        zip(cameras["rotations"], cameras["positions"], strict=True)
    ):
        images.append(o3d.t.io.read_image(str(folder / "photos" / f"{number:04d}.png")))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
        inside.append(o3d.core.Tensor(matrix))
        outside.append(o3d.core.Tensor(pose))
    albedo = mesh.project_images_to_albedo(images, inside, outside, SIDE, True)
    pixels = albedo.as_tensor().numpy()
    from PIL import Image

    Image.fromarray(pixels).save(folder / "result-open3d.png")
    # Row 0 of the image is v = 1: the upper left is where it should be.
    wedges[..., 1] = 1.0 - wedges[..., 1]
    return mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy(), wedges


if __name__ == "__main__":
    main()
