"""Why nobody was reached, in words: what the system says of it is for programmers.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import errno
import re
import ssl
from collections.abc import Iterator

__all__ = ["why_unreached"]

_ERRNO = re.compile(r"\[Errno (\d+)\]")


def why_unreached(error: BaseException) -> str:
    """Say why a connection did not come about, and what may be wrong.

    Parameters
    ----------
    error : BaseException
        Of asyncio, ssl, websockets or httpx; those that it came of are looked at, too.

    Examples
    --------
    >>> why_unreached(ConnectionRefusedError(errno.ECONNREFUSED, "Connect call failed"))
    'nothing listens there; is the service running, and is this its port?'
    """
    for cause in _causes(error):
        if isinstance(cause, ssl.SSLCertVerificationError):
            return str(cause)
        if isinstance(cause, ssl.SSLError) and "WRONG_VERSION_NUMBER" in str(cause):
            return "what listens there speaks no TLS; expected http:// for it"
        # Of socket, which this module does not import.
        if type(cause).__name__ == "gaierror":
            return "no machine has that name"
        if isinstance(cause, TimeoutError):
            return "no answer in time"
        # Several addresses of one name, each refused, come as one error without a number.
        refused = {str(errno.ECONNREFUSED)}
        if isinstance(cause, OSError) and set(_ERRNO.findall(str(cause))) == refused:
            return "nothing listens there; is the service running, and is this its port?"
    return str(error) or type(error).__name__


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Walk from an error to what it came of; no chain of ours is long."""
    current: BaseException | None = error
    while current is not None:
        yield current
        current = current.__cause__ or current.__context__
