"""What a user states of a mesh because its file does not say it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Final, Literal

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Notation, Option

__all__ = ["MESH", "MeshStatement"]

MESH: Final = "mesh"
"""Format of a mesh among the files that a scene was built from."""

SHIFT: Final = Notation(
    "E N H",
    lambda values, _what: tuple(float(value) for value in values),
    str,
    tuple[float, float, float],
)


@dataclass(frozen=True, slots=True)
class MeshStatement:
    """Which way is up in a mesh, what is to be added, and whether it is one.

    Raises
    ------
    OptionError
        A shift that is not finite.
    """

    up: Annotated[Literal["y", "z"] | None, Option(unset="z; in GLB y, as glTF has it")] = None
    """Axis of a mesh that points up. Survey programs write OBJ and PLY with z, modellers with
    y."""
    shift: Annotated[
        tuple[float, float, float] | None,
        Option(notation=SHIFT, unset="what files beside the mesh state (Pix4D, OpenDroneMap, ...)"),
    ] = None
    """Easting, northing and height to add to a mesh's coordinates, in their unit: --shift 500000
    5200000 0."""
    as_points: Annotated[bool, Option()] = False
    """Take a mesh for the points at its vertices, and reconstruct them."""

    def __post_init__(self) -> None:
        if self.shift is not None and not all(map(math.isfinite, self.shift)):
            raise OptionError(f"shift {self.shift}; expected three finite numbers")

    @property
    def recorded(self) -> dict[str, Any]:
        """Stated values as JSON, by the names of the options; empty without any."""
        stated = {name: value for name, value in asdict(self).items() if value not in (None, False)}
        if self.shift is not None:
            stated["shift"] = [*self.shift]
        return stated
