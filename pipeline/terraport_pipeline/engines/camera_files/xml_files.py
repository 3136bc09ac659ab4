"""XML of other programs, parsed whole and without entities."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.raw_cameras import AGAIN, MAX_TEXT_BYTES, check_size
from terraport_pipeline.errors import ReadError

__all__ = ["parse_xml", "xml_numbers"]


def parse_xml(path: Path, advice: str) -> ET.Element:
    """Parse a file; tags and attributes keep their prefixes.

    Parameters
    ----------
    path : Path
    advice : str
        What helps where the file is too large to be one of cameras alone.

    Raises
    ------
    ReadError
        No XML, one with a document type, or too large.
    """
    check_size(path, MAX_TEXT_BYTES, advice)
    data = path.read_bytes()
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    def refuse(*_: object) -> None:
        raise ReadError(path, "XML with a document type", "export the cameras again")

    # Without a document type there are no entities to expand or to fetch. The parser tells of one
    # in whatever encoding the file is; searching the bytes would miss it in UTF-16.
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ReadError(path, f"no XML ({error})", AGAIN, f"line {error.lineno:,}") from error
    except (LookupError, ValueError) as error:  # an encoding that Python, or expat, does not know
        raise ReadError(path, f"no XML ({error})", AGAIN, "line 1") from error
    return builder.close()


def xml_numbers(path: Path, text: str | None, expected: int, location: str) -> Float64:
    """Parse the finite numbers of an element or attribute.

    Raises
    ------
    ReadError
        Another count, no number, NaN or infinity.
    """
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != expected or not np.isfinite(values).all():
        raise ReadError(
            path, f"{(text or '')[:80]!r} is not {expected} finite numbers", AGAIN, location
        )
    return values
