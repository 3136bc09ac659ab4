"""``terraport land``: services that refuse, and places that the scene does not reach."""

from __future__ import annotations

from typing import Final

from terraport.address import Access, SceneUrl
from terraport.errors import HttpError, ServerError, TerraportError, UsageError
from terraport.http import SceneHttp
from terraport.landing import Landing
from terraport.outside import SceneBox
from terraport_wire import CLOSE_CODES, HTTP_STATUS, ErrorCode

__all__ = ["explain_refusal", "nothing_there", "require_reach"]

_UNAUTHORISED: Final = HTTP_STATUS[CLOSE_CODES[ErrorCode.UNAUTHORISED]]

_LIST_TIMEOUT_S: Final = 5.0
"""For the list of scenes, which only adds to an error."""

Point = tuple[float, float, float]


async def explain_refusal(
    error: ServerError | HttpError, url: str, token: str | None
) -> TerraportError:
    """Add to a refusal what can be typed about it; return any other as it is.

    Parameters
    ----------
    error : ServerError or HttpError
    url, token : str
        As they stood on the command line.
    """
    code = error.code if isinstance(error, ServerError) else None
    status = error.status if isinstance(error, HttpError) else 0
    if code == ErrorCode.UNAUTHORISED or status == _UNAUTHORISED:
        advice = "give one by --token or TERRAPORT_TOKEN"
        if token is not None:
            advice = "the one given is wrong, has expired, or is not for this service"
        return TerraportError(f"{error}; {advice}")
    if code == ErrorCode.UNKNOWN_SCENE:
        http = SceneHttp(SceneUrl.parse(url), Access(token), _LIST_TIMEOUT_S)
        try:
            ids = await http.scene_ids()
        except TerraportError:
            return error
        finally:
            await http.aclose()
        return TerraportError(f"{error}; it serves {', '.join(ids) or 'none'}")
    return error


def require_reach(
    box: SceneBox, given: Point, position: Point, radius_m: float, *, crs: bool, ground: bool
) -> None:
    """Refuse a place where nothing can be, before anything is loaded or written.

    Parameters
    ----------
    box : SceneBox
        Around the scene.
    given : tuple of float
        X Y Z as they stood on the command line.
    position : tuple of float
        The same in the scene frame, metres.
    radius_m : float
        Of the landing.
    crs : bool
        Whether `given` was read in the survey's CRS.
    ground : bool
        Whether the surface above or below was asked for; there is none.

    Raises
    ------
    UsageError
        With how far away it is, where the scene is, and what was perhaps meant.
    """
    # A radius that is none is refused by the landing itself.
    is_far = 0 < radius_m < box.distance_m(position)
    if is_far or (ground and not box.is_above_or_below(position)):
        raise UsageError(box.explain(position, radius_m) + _meant(box, given, position, crs=crs))
    if ground:
        raise UsageError(f"no surface above or below {position}, expected a place on it")


def nothing_there(landing: Landing) -> str:
    """Say why a landing that succeeded has no detail."""
    if landing.outside_m is not None:
        return f"the place lies {landing.outside_m:,.0f} m outside the scene: nothing is there"
    return (
        f"no detail within {landing.plan.radius_m:g} m of there: at most the base mesh is; "
        "a larger --radius may reach some"
    )


def _meant(box: SceneBox, given: Point, position: Point, *, crs: bool) -> str:
    if not crs and box.is_survey_place(given):
        return ". As easting, northing and height it is: add --crs"
    if crs and not box.distance_m(given):
        return ". As x, y and z of the scene it is: leave out --crs"
    if box.is_above_or_below(position):
        return ". There is ground above or below: add --ground"
    return ""
