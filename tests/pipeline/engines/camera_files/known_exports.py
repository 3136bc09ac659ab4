"""The known flight in the forms of more programs, written from their documentation.

As in ``known_cameras.py`` the writers share nothing with the readers under test: angles are taken
from where the picture's axes point, distortions from the projection's own formula.
"""

from __future__ import annotations

import numpy as np
from pipeline.engines.camera_files.known_cameras import (
    HEIGHT,
    OFFSET,
    WIDTH,
    quaternion,
)

UP_BACK = np.diag([1.0, -1.0, -1.0])
"""Camera axes x right, y down, z forward to x right, y up, z backward."""


def write_nvm(folder, cameras, radial=0.0, heading="NVM_V3", offset=OFFSET, blanks=False):
    names, turns, centres, lens = cameras
    lines = [heading, "", str(len(names))]
    for name, turn, centre in zip(names, turns, centres, strict=True):
        numbers = (lens.fx, *quaternion(turn), *(centre - offset), radial)
        shown = f"flight 1/{name}".replace(" ", '"') if blanks else name
        lines.append(f"{shown}\t" + " ".join(repr(float(value)) for value in numbers) + " 0")
    lines += ["", "1", "1 2 3 255 0 0 2 0 7 1.5 2.5 1 8 3.5 4.5", "", "1"]
    lines += ["lost.JPG\t0 1 0 0 0 0 0 0 0 0", "", "0", "", "0", "", "#the last part", "0"]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "flight.nvm"
    path.write_text("\n".join(lines) + "\n")
    (folder / "OFFSET.txt").write_text("{} {} {}\n".format(*offset))
    return path


def heading_pitch_roll(turn):
    """Where the picture's up points, and how far its right dips below the horizon."""
    right, up, back = UP_BACK @ turn
    heading = np.degrees(np.arctan2(up[0], up[1]))
    pitch = np.degrees(np.arcsin(up[2]))
    roll = np.degrees(np.arctan2(-right[2], back[2]))
    return heading, pitch, roll


RC_HEADING = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
RS_HEADING = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2"


def rc_numbers(lens):
    """Focal length, principal point, k1..k4, t1, t2."""
    k = [*lens.radial, 0, 0, 0, 0][:4]
    longer = max(lens.width, lens.height)
    return (
        lens.fx * 36 / longer,
        (lens.cx - lens.width / 2) / longer,
        (lens.cy - lens.height / 2) / longer,
        *k,
        lens.tangential[1],
        lens.tangential[0],
    )


def write_rc_csv(folder, cameras, heading=RC_HEADING, offset=(0.0, 0.0, 0.0), positions=None):
    names, turns, centres, lens = cameras
    lines = ["#cameras 6", heading] if heading == RC_HEADING else [heading]
    positions = centres - offset if positions is None else positions
    for name, turn, position in zip(names, turns, positions, strict=True):
        numbers = (*position, *heading_pitch_roll(turn), *rc_numbers(lens))
        lines.append(f"{name}," + ",".join(f"{value:.15e}" for value in numbers))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "registration.csv"
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
    <rdf:Description xcr:Version="3" xcr:PosePrior="locked" xcr:Coordinates="absolute"
       xcr:DistortionModel="{model}" xcr:FocalLength35mm="{f!r}"
       xcr:Skew="0" xcr:AspectRatio="{aspect!r}" xcr:PrincipalPointU="{px!r}"
       xcr:PrincipalPointV="{py!r}" xcr:CalibrationPrior="exact" xcr:CalibrationGroup="-1"
       xcr:DistortionGroup="-1" xcr:InTexturing="1" xcr:InMeshing="1"
       xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
      <xcr:Rotation>{rotation}</xcr:Rotation>
      <xcr:Position>{position}</xcr:Position>
      <xcr:DistortionCoeficients>{terms}</xcr:DistortionCoeficients>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>
"""


def write_xmp(folder, cameras, offset=(0.0, 0.0, 0.0), model="brown3t2"):
    names, turns, centres, lens = cameras
    folder.mkdir(parents=True, exist_ok=True)
    f, px, py, *terms = map(float, rc_numbers(lens))
    for name, turn, centre in zip(names, turns, centres, strict=True):
        text = XMP.format(
            model=model,
            f=f,
            px=px,
            py=py,
            aspect=lens.fy / lens.fx,
            rotation=" ".join(repr(float(value)) for value in turn.ravel()),
            position=" ".join(repr(float(value)) for value in centre - offset),
            terms=" ".join(map(repr, terms)),
        )
        (folder / name.replace(".JPG", ".xmp")).write_text(text)
    unaligned = text[: text.index("<xcr:Rotation")] + "</rdf:Description></rdf:RDF></x:xmpmeta>"
    (folder / "DJI_9998.xmp").write_text(unaligned)
    (folder / "DJI_9999.xmp").write_text('<x:xmpmeta xmlns:x="adobe:ns:meta/"/>')
    return folder


def write_blocks(
    path, cameras, system="EPSG:32615", axes="XRightYDown", in_pixels=True, positions=None
):
    """Bentley's form; of a camera whose axes are as `axes` says."""
    names, turns, centres, lens = cameras
    # rows: where their x, y and z point in ours
    rows = {"XRightYDown": np.eye(3), "XRightYUp": UP_BACK}.get(axes)
    if rows is None:  # XUpYRight: x is our -y, y our x, z = x cross y
        rows = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    photos = []
    positions = centres if positions is None else positions
    for index, (name, turn, centre) in enumerate(zip(names, turns, positions, strict=True)):
        matrix = rows @ turn
        cells = "".join(
            f"<M_{i}{j}>{float(matrix[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3)
        )
        x, y, z = map(float, centre)
        photos.append(
            f"<Photo><Id>{index}</Id><ImagePath>D:\\flight\\{name}</ImagePath>"
            f"<Pose><Rotation>{cells}<Accurate>true</Accurate></Rotation>"
            f"<Center><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></Center></Pose></Photo>"
        )
    photos.append("<Photo><Id>9</Id><ImagePath>D:\\flight\\DJI_9999.JPG</ImagePath></Photo>")
    focal = f"<FocalLengthPixels>{lens.fx!r}</FocalLengthPixels>"
    if not in_pixels:
        focal = f"<FocalLength>{lens.fx * 13.2 / 2000!r}</FocalLength><SensorSize>13.2</SensorSize>"
    k = lens.radial
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"""<?xml version="1.0" encoding="utf-8"?>
<BlocksExchange version="3.2"><SpatialReferenceSystems>
<SRS><Id>0</Id><Name>of the block</Name><Definition>{system}</Definition></SRS>
</SpatialReferenceSystems><Block><Name>Block_1 - AT</Name><SRSId>0</SRSId><Photogroups><Photogroup>
<Name>P4</Name><ImageDimensions><Width>{WIDTH}</Width><Height>{HEIGHT}</Height></ImageDimensions>
<CameraModelType>Perspective</CameraModelType>{focal}<CameraOrientation>{axes}</CameraOrientation>
<PrincipalPoint><x>{lens.cx - 0.5!r}</x><y>{lens.cy - 0.5!r}</y></PrincipalPoint>
<Distortion><K1>{k[0]}</K1><K2>{k[1]}</K2><K3>{k[2]}</K3>
<P1>{lens.tangential[1]}</P1><P2>{lens.tangential[0]}</P2></Distortion>
<AspectRatio>{lens.fy / lens.fx!r}</AspectRatio><Skew>0</Skew>
{"".join(photos)}</Photogroup></Photogroups></Block></BlocksExchange>
"""
    )
    return path


def write_omega_phi_kappa(folder, cameras, system, positions=None):
    """Metashape's text, and its calibration beside it."""
    names, turns, centres, lens = cameras
    lines = [f"# CoordinateSystem: {system}", f"# Cameras ({len(names)})"]
    lines.append(
        "# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23, r31, r32, r33"
    )
    for name, turn, centre in zip(
        names, turns, centres if positions is None else positions, strict=True
    ):
        to_world = (UP_BACK @ turn).T
        omega = np.degrees(np.arctan2(-to_world[1, 2], to_world[2, 2]))
        phi = np.degrees(np.arcsin(to_world[0, 2]))
        kappa = np.degrees(np.arctan2(-to_world[0, 1], to_world[0, 0]))
        numbers = (*centre, omega, phi, kappa, *to_world.T.ravel())
        lines.append("\t".join([name.removesuffix(".JPG"), *(f"{v:.13f}" for v in numbers)]))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "cameras.txt"
    path.write_text("\n".join(lines) + "\n")
    k = lens.radial
    (folder / "calibration.xml").write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?>
<calibration><projection>frame</projection><width>{WIDTH}</width><height>{HEIGHT}</height>
<f>{lens.fy}</f><cx>{lens.cx - 1000}</cx><cy>{lens.cy - 562.5}</cy><b1>{lens.fx - lens.fy}</b1>
<k1>{k[0]}</k1><k2>{k[1]}</k2><k3>{k[2]}</k3><p1>{lens.tangential[1]}</p1>
<p2>{lens.tangential[0]}</p2><date>2024-05-26T08:27:27Z</date></calibration>
"""
    )
    return path
