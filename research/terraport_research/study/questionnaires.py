"""Scores of the Simulator Sickness Questionnaire and of the Virtual Reality Sickness Questionnaire.

PURE: no I/O, no clock.

References
----------
R. S. Kennedy, N. E. Lane, K. S. Berbaum, M. G. Lilienthal, "Simulator Sickness Questionnaire: an
enhanced method for quantifying simulator sickness", The International Journal of Aviation
Psychology 3(3), 1993.

H. K. Kim, J. Park, Y. Choi, M. Choe, "Virtual reality sickness questionnaire (VRSQ): motion
sickness measurement index in a virtual reality environment", Applied Ergonomics 69, 2018.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

__all__ = ["ssq_scores", "vrsq_scores"]

_NAUSEA: Final = (0, 5, 6, 7, 8, 14, 15)
_OCULOMOTOR: Final = (0, 1, 2, 3, 4, 8, 10)
_DISORIENTATION: Final = (4, 7, 9, 10, 11, 12, 13)
"""Rows of the SSQ's sixteen that each scale sums; some count in two."""
_WEIGHTS: Final = (9.54, 7.58, 13.92)
_TOTAL: Final = 3.74
_VRSQ_OCULOMOTOR: Final = 4
"""The first four of the VRSQ's nine."""
_HIGHEST: Final = 3


def ssq_scores(answers: Sequence[int]) -> dict[str, float]:
    """Score sixteen answers of 0 to 3.

    Returns
    -------
    dict
        ``nausea``, ``oculomotor``, ``disorientation``, ``total``.

    Examples
    --------
    >>> ssq_scores([0] * 16)["total"]
    0.0
    >>> round(ssq_scores([3] * 16)["total"], 2)
    235.62
    """
    raw = [sum(answers[row] for row in rows) for rows in (_NAUSEA, _OCULOMOTOR, _DISORIENTATION)]
    nausea, oculomotor, disorientation = (
        value * weight for value, weight in zip(raw, _WEIGHTS, strict=True)
    )
    return {
        "nausea": nausea,
        "oculomotor": oculomotor,
        "disorientation": disorientation,
        "total": sum(raw) * _TOTAL,
    }


def vrsq_scores(answers: Sequence[int]) -> dict[str, float]:
    """Score nine answers of 0 to 3, oculomotor first; 0 to 100.

    Examples
    --------
    >>> vrsq_scores([3] * 9)
    {'oculomotor': 100.0, 'disorientation': 100.0, 'total': 100.0}
    """
    parts = answers[:_VRSQ_OCULOMOTOR], answers[_VRSQ_OCULOMOTOR:]
    oculomotor, disorientation = (100.0 * sum(part) / (len(part) * _HIGHEST) for part in parts)
    return {
        "oculomotor": oculomotor,
        "disorientation": disorientation,
        "total": (oculomotor + disorientation) / 2,
    }
