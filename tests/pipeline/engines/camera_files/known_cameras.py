"""One survey flight with known cameras, written in each program's format from its documentation.

The writers here know the formats by themselves; they share nothing with the readers under test.
"""

from __future__ import annotations

import json
import struct

import numpy as np

from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.model import Crs

ORIGIN = np.array([576_700.0, 5_188_150.0, 160.0])
OFFSET = (576_600.0, 5_188_100.0, 0.0)
UTM_15N = Crs("WGS 84 / UTM zone 15N", "", 32615)
WIDTH, HEIGHT = 2000, 1125
BROWN = Lens(
    WIDTH, HEIGHT, 1457.1, 1454.0, 1010.5, 550.25,
    radial=(0.0144, 0.0427, -0.01), tangential=(-0.0015, 0.0007),
)  # fmt: skip
FISHEYE = Lens(
    WIDTH, HEIGHT, 880.0, 881.0, 1003.0, 560.0, model="fisheye", radial=(0.02, -0.004, 0.001, 0.0)
)
SQUARE = Lens(WIDTH, HEIGHT, 1457.1, 1457.1, 1000.0, 562.5, radial=(0.0144, 0.0427))
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""East, north, up to the scene's axes; written down again so that the readers' is tested."""


def rotation_about(axis, angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def flight(lens):
    """Six views, 60 m above the ground, in rows, each a little tilted and turned.

    Returns names, rotations CRS axes -> camera (x right, y down, z forward), centres in the CRS.
    """
    down = np.diag([1.0, -1.0, -1.0])
    names, turns, centres = [], [], []
    for index in range(6):
        tilt = rotation_about(0, 3.0 + 4 * index) @ rotation_about(1, -5.0 + 2 * index)
        names.append(f"DJI_{index:04}.JPG")
        turns.append(tilt @ down @ rotation_about(2, 40.0 * index).T)
        away = np.array([20.0 * (index % 3), 15.0 * (index // 3), 60.0 + index])
        centres.append(ORIGIN + away)
    return names, np.array(turns), np.array(centres), lens


def truth(cameras):
    """The same as views in the scene."""
    names, turns, centres, lens = cameras
    return tuple(
        View(name, lens, turn @ AXES.T, AXES @ (centre - ORIGIN))
        for name, turn, centre in zip(names, turns, centres, strict=True)
    )


def ground():
    """Points of the scene below the flight."""
    rng = np.random.default_rng(2)
    return np.column_stack(
        [rng.uniform(-30, 70, 1500), rng.uniform(-3, 3, 1500), rng.uniform(-50, 30, 1500)]
    )


def assert_same_pixels(views, cameras, within_px=0.01):
    """Every point falls where the known camera puts it."""
    expected = {view.name: view for view in truth(cameras)}
    assert sorted(view.name for view in views) == sorted(expected)
    points = ground()
    compared = 0
    for view in views:
        projected, depth_m = view.project(points)
        true_px, true_depth_m = expected[view.name].project(points)
        inside = (np.abs(true_px - (1000, 562)) < (1000, 562)).all(axis=1)
        assert np.abs(projected - true_px)[inside].max() < within_px
        assert np.abs(depth_m - true_depth_m).max() < 1e-4
        compared += int(inside.sum())
    assert compared > 1000


def quaternion(turn):
    """w, x, y, z of a rotation by its eigenvector (Bar-Itzhack)."""
    r = turn
    k = (
        np.array(
            [
                [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
                [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
            ]
        )
        / 3
    )
    _, vectors = np.linalg.eigh(k)
    x, y, z, w = vectors[:, -1]
    return w, x, y, z


def rotation_vector(turn):
    """Axis times angle."""
    w, *axis = quaternion(turn)
    sine = np.linalg.norm(axis)
    return (2 * np.arctan2(sine, w) * np.array(axis) / sine).tolist()


def colmap_parameters(lens):
    k = [*lens.radial, 0, 0, 0, 0]
    common = [lens.fx, lens.fy, lens.cx, lens.cy]
    if lens.model == "fisheye":
        return "OPENCV_FISHEYE", 5, [*common, *k[:4]]
    return "FULL_OPENCV", 6, [*common, *k[:2], *lens.tangential, k[2], 0, 0, 0]


def write_colmap_text(folder, cameras, offset=OFFSET):
    names, turns, centres, lens = cameras
    folder.mkdir(parents=True, exist_ok=True)
    model, _, values = colmap_parameters(lens)
    numbers = " ".join(map(repr, map(float, values)))
    (folder / "cameras.txt").write_text(f"# comment\n7 {model} {WIDTH} {HEIGHT} {numbers}\n")
    lines = ["# Image list with two lines of data per image:"]
    for index, (name, turn, centre) in enumerate(zip(names, turns, centres, strict=True)):
        shift = -turn @ (centre - offset)
        numbers = " ".join(map(repr, map(float, (*quaternion(turn), *shift))))
        lines.append(f"{index + 1} {numbers} 7 {name}")
        lines.append("" if index % 2 else "10.5 20.5 -1 30.0 40.0 17")
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    shift_text = ", ".join(map(str, offset))
    (folder / "OFFSET.txt").write_text(f"World = COLMAP + ({shift_text}), EPSG:32615 (UTM 15N)\n")


def write_colmap_binary(folder, cameras, offset=OFFSET):
    names, turns, centres, lens = cameras
    folder.mkdir(parents=True, exist_ok=True)
    _, number, values = colmap_parameters(lens)
    head = struct.pack("<QIiQQ", 1, 7, number, WIDTH, HEIGHT)
    (folder / "cameras.bin").write_bytes(head + struct.pack(f"<{len(values)}d", *values))
    records = [struct.pack("<Q", len(names))]
    for index, (name, turn, centre) in enumerate(zip(names, turns, centres, strict=True)):
        shift = -turn @ (centre - offset)
        records.append(struct.pack("<I7dI", index + 1, *quaternion(turn), *shift, 7))
        records.append(name.encode() + b"\0" + struct.pack("<Q", index))
        records.append(struct.pack("<ddQ", 1.0, 2.0, 2**64 - 1) * index)
    (folder / "images.bin").write_bytes(b"".join(records))


def opensfm_camera(lens):
    k = [*lens.radial, 0, 0, 0, 0]
    camera = {
        "width": WIDTH,
        "height": HEIGHT,
        "focal_x": lens.fx / 2000,
        "focal_y": lens.fy / 2000,
        "c_x": (lens.cx - 1000) / 2000,
        "c_y": (lens.cy - 562.5) / 2000,
        "k1": k[0],
        "k2": k[1],
        "k3": k[2],
    }
    if lens.model == "fisheye":
        return {"projection_type": "fisheye_opencv", "k4": k[3], **camera}
    return {
        "projection_type": "brown",
        "p1": lens.tangential[0],
        "p2": lens.tangential[1],
        **camera,
    }


def write_opensfm(path, cameras, offset=OFFSET, reference=None):
    names, turns, centres, lens = cameras
    shots = {
        name: {
            "rotation": rotation_vector(turn),
            "translation": (-turn @ (centre - offset)).tolist(),
            "camera": "v2 dji",
        }
        for name, turn, centre in zip(names, turns, centres, strict=True)
    }
    reconstruction = {"cameras": {"v2 dji": opensfm_camera(lens)}, "shots": shots, "points": {}}
    if reference is not None:
        reconstruction["reference_lla"] = reference
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([reconstruction]))


def write_shots_geojson(folder, cameras):
    names, turns, centres, lens = cameras
    features = [
        {
            "type": "Feature",
            "properties": {
                "filename": name,
                "focal": 0.7,
                "width": WIDTH,
                "height": HEIGHT,
                "translation": centre.tolist(),
                "rotation": rotation_vector(turn),
            },
            "geometry": {"type": "Point", "coordinates": [-92.0, 46.8, 200.0]},
        }
        for name, turn, centre in zip(names, turns, centres, strict=True)
    ]
    (folder / "odm_report").mkdir(parents=True, exist_ok=True)
    shots = folder / "odm_report" / "shots.geojson"
    shots.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (folder / "cameras.json").write_text(json.dumps({"v2 dji": opensfm_camera(lens)}))
    return shots


PIX4D_HEADING = """fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X

"""


def write_pix4d(folder, cameras, offset=OFFSET):
    names, turns, centres, lens = cameras
    text = [PIX4D_HEADING]
    for name, turn, centre in zip(names, turns, centres, strict=True):
        rows = [
            [lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1],
            lens.radial, lens.tangential, centre - offset, *turn,
        ]  # fmt: skip
        text.append(f"{name} {WIDTH} {HEIGHT}\n")
        text += [" ".join(f"{value:.20f}" for value in row) + "\n" for row in rows]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "beach_calibrated_camera_parameters.txt"
    path.write_text("".join(text))
    (folder / "beach_offset.xyz").write_text("{} {} {}".format(*offset))
    return path


def write_pix4d_external(folder, cameras):
    """As Pix4D: output coordinates and angles; lens in millimetres of a 12.8 x 7.2 mm sensor."""
    names, turns, centres, lens = cameras
    pixel_mm = 12.8 / WIDTH
    lines = ["imageName X Y Z Omega Phi Kappa"]
    for name, turn, centre in zip(names, turns, centres, strict=True):
        to_world = turn.T @ np.diag([1.0, -1.0, -1.0])  # of a camera that looks along -z, y up
        omega = np.degrees(np.arctan2(-to_world[1, 2], to_world[2, 2]))
        phi = np.degrees(np.arcsin(to_world[0, 2]))
        kappa = np.degrees(np.arctan2(-to_world[0, 1], to_world[0, 0]))
        numbers = " ".join(f"{value:.12f}" for value in (*centre, omega, phi, kappa))
        lines.append(f"{name} {numbers}")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "beach_calibrated_external_camera_parameters.txt"
    path.write_text("\n".join(lines) + "\n")
    k, p = lens.radial, lens.tangential
    cam = folder / "beach_pix4d_calibrated_internal_camera_parameters.cam"
    cam.write_text(
        "Pix4D camera calibration file 0\n"
        "#Focal Length mm assuming a sensor width of 12.8x7.2mm\n"
        f"F {lens.fx * pixel_mm:.12f}\n#Principal Point mm\n"
        f"Px {lens.cx * pixel_mm:.12f}\nPy {lens.cy * pixel_mm:.12f}\n"
        f"#Symmetrical Lens Distortion Coeffs\nK1 {k[0]}\nK2 {k[1]}\nK3 {k[2]}\n"
        f"#Tangential Lens Distortion Coeffs\nT1 {p[0]}\nT2 {p[1]}\n"
    )
    return path


def write_agisoft(path, cameras, reference="", offset=OFFSET, chunk=None):
    """Metashape's export: `chunk` = (scale, rotation, translation) of chunk to world."""
    names, turns, centres, lens = cameras
    scale, rotation, shift = chunk or (1.0, np.eye(3), np.zeros(3))
    k = [*lens.radial, 0, 0, 0, 0]
    camera_tags = []
    for name, turn, centre in zip(names, turns, centres, strict=True):
        matrix = np.eye(4)
        matrix[:3, :3] = rotation.T @ turn.T
        matrix[:3, 3] = rotation.T @ (centre - offset - shift) / scale
        numbers = " ".join(map(repr, map(float, matrix.ravel())))
        label = name.removesuffix(".JPG")
        camera_tags.append(
            f'<camera id="1" sensor_id="0" label="{label}"><transform>{numbers}</transform>'
            "<orientation>1</orientation></camera>"
        )
    camera_tags.append('<camera id="9" sensor_id="0" label="DJI_9999"/>')
    move = ""
    if chunk is not None:
        r, t = (" ".join(map(repr, map(float, np.ravel(v)))) for v in (rotation, shift))
        move = (
            f"<transform><rotation>{r}</rotation><translation>{t}</translation>"
            f"<scale>{scale!r}</scale></transform>"
        )
    kind = "fisheye" if lens.model == "fisheye" else "frame"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
<sensors next_id="1"><sensor id="0" label="FC220" type="{kind}">
<resolution width="{WIDTH}" height="{HEIGHT}"/>
<calibration type="{kind}" class="adjusted"><resolution width="{WIDTH}" height="{HEIGHT}"/>
<f>{lens.fy}</f><cx>{lens.cx - 1000}</cx><cy>{lens.cy - 562.5}</cy>
<b1>{lens.fx - lens.fy}</b1><b2>{lens.skew}</b2>
<k1>{k[0]}</k1><k2>{k[1]}</k2><k3>{k[2]}</k3><k4>{k[3]}</k4>
<p1>{lens.tangential[1]}</p1><p2>{lens.tangential[0]}</p2></calibration></sensor></sensors>
<cameras next_id="9"><group id="0" label="flight">{"".join(camera_tags)}</group></cameras>
{move}<reference>{reference}</reference></chunk></document>
"""
    )


def write_bundler(folder, cameras, offset=OFFSET):
    names, turns, centres, lens = cameras
    flip = np.diag([1.0, -1.0, -1.0])
    lines = ["# Bundle file v0.3", f"{len(names) + 1} 1"]
    for turn, centre in zip(turns, centres, strict=True):
        rotation = flip @ turn
        lines.append(f"{lens.fx!r} {lens.radial[0]!r} {lens.radial[1]!r}")
        for row in (*rotation, -rotation @ (centre - offset)):
            lines.append(" ".join(map(repr, map(float, row))))
    lines += ["0 0 0"] * 5 + ["1 2 3", "255 0 0", "1 0 17 12.5 -3.5"]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bundle.out").write_text("\n".join(lines) + "\n")
    (folder / "list.txt").write_text(
        "".join(f"./{name} 0 {lens.fx}\n" for name in (*names, "DJI_9999.JPG"))
    )
    (folder / "OFFSET.txt").write_text("{} {} {}\n".format(*offset))
