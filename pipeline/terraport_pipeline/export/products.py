"""What can be handed on, and in which files: the ending says the format, and mostly what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, get_args

from terraport_pipeline.errors import OptionError

__all__ = ["ENDINGS", "PRODUCTS", "Product", "product_of"]

Product = Literal["orthophoto", "heights", "mesh", "points", "contours", "section", "tiles"]

PRODUCTS: Final[tuple[Product, ...]] = get_args(Product)

ENDINGS: Final[dict[str, tuple[Product, ...]]] = {
    ".tif": ("orthophoto", "heights"),
    ".tiff": ("orthophoto", "heights"),
    ".obj": ("mesh",),
    ".glb": ("mesh",),
    ".ply": ("mesh",),
    ".las": ("points",),
    ".laz": ("points",),
    ".gpkg": ("contours",),
    ".geojson": ("contours",),
    ".dxf": ("contours", "section"),
    ".csv": ("section",),
    ".3tz": ("tiles",),
}
"""What a file of each ending may hold."""


def product_of(path: Path, stated: Product | None) -> Product:
    """Decide what a file shall hold.

    Parameters
    ----------
    path : Path
        Its ending is the format; tiles may be a folder, of any other name.
    stated : Product, optional
        What the user says; needed where the ending leaves a choice.

    Raises
    ------
    OptionError
        The ending is none of ours, leaves a choice, or does not fit what is stated.

    Examples
    --------
    >>> product_of(Path("pit.laz"), None), product_of(Path("pit.tif"), "heights")
    ('points', 'heights')
    >>> product_of(Path("folder"), "tiles")
    'tiles'
    """
    possible = ENDINGS.get(path.suffix.lower())
    if stated == "tiles" and possible is None:
        return stated  # a folder
    if possible is None:
        raise OptionError(
            f"{path.name} ends with {path.suffix or 'nothing'!r}, expected one of "
            f"{' '.join(ENDINGS)}"
        )
    if stated is None:
        if len(possible) > 1:
            choice = " or ".join(f"--as {product}" for product in possible)
            raise OptionError(f"{path.name} may be {' or '.join(possible)}; add {choice}")
        return possible[0]
    if stated not in possible:
        endings = " ".join(ending for ending, products in ENDINGS.items() if stated in products)
        raise OptionError(f"--as {stated} in {path.name}; expected a name that ends with {endings}")
    return stated
