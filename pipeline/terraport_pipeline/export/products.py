"""What can be handed on, and in which files: the ending says the format, and mostly what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, get_args

from terraport_pipeline.errors import OptionError

__all__ = ["ENDINGS", "PRODUCTS", "Product", "product_of"]

Product = Literal[
    "orthophoto", "heights", "mesh", "points", "contours", "section", "regions", "tiles"
]

PRODUCTS: Final[tuple[Product, ...]] = get_args(Product)

ENDINGS: Final[dict[str, tuple[Product, ...]]] = {
    ".tif": ("orthophoto", "heights"),
    ".tiff": ("orthophoto", "heights"),
    ".obj": ("mesh",),
    ".glb": ("mesh",),
    ".ply": ("mesh",),
    ".las": ("points",),
    ".laz": ("points",),
    ".gpkg": ("contours", "regions"),
    ".geojson": ("contours", "regions"),
    ".shp": ("contours", "regions"),
    ".dxf": ("contours", "section", "regions"),
    ".csv": ("section",),
    ".3tz": ("tiles",),
}
"""What a file of each ending may hold."""

_USUAL: Final[dict[str, Product]] = {
    ".gpkg": "contours",
    ".geojson": "contours",
    ".shp": "regions",
}
"""What it holds where nobody says."""


def product_of(
    path: Path, stated: Product | None, *, interval: float | None = None, line: str | None = None
) -> Product:
    """Choose the product of a file: as stated, or by an option, the file's name or its extension.

    Parameters
    ----------
    path : Path
        Its extension is the format; tiles may be a folder, with any other name.
    stated : Product, optional
        Product that the user states; needed if the extension is ambiguous (.tif, .dxf) and neither
        an option nor the name decides it.
    interval : float, optional
        Interval of contours; other products have none.
    line : str, optional
        Line of a section; other products have none.

    Raises
    ------
    OptionError
        The extension is unknown, ambiguous, or does not fit the stated product.

    Examples
    --------
    >>> product_of(Path("pit.laz"), None), product_of(Path("pit.tif"), "heights")
    ('points', 'heights')
    >>> product_of(Path("folder"), "tiles")
    'tiles'
    >>> product_of(Path("pit.dxf"), None, interval=2), product_of(Path("regions.gpkg"), None)
    ('contours', 'regions')
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
        implied: dict[str, bool] = {
            "contours": interval is not None,
            "section": line is not None,
            path.stem.lower(): True,
        }
        for product in possible:
            if implied.get(product):
                return product
        usual = _USUAL.get(path.suffix.lower())
        if usual is not None:
            return usual
        if len(possible) > 1:
            choice = " or ".join(f"--as {product}" for product in possible)
            raise OptionError(f"{path.name} may be {' or '.join(possible)}; add {choice}")
        return possible[0]
    if stated not in possible:
        endings = " ".join(ending for ending, products in ENDINGS.items() if stated in products)
        raise OptionError(f"--as {stated} in {path.name}; expected a name that ends with {endings}")
    return stated
