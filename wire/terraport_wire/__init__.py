"""terraport wire protocol: messages, payload frames, limits and errors (PURE: bytes <-> values).

The specification is spec/protocol.md.
"""

from __future__ import annotations

from . import (
    client_messages,
    codec,
    errors,
    frames,
    group_messages,
    limits,
    messages,
    server_messages,
)
from .client_messages import *  # noqa: F403 - a message is named where it is defined, nowhere else
from .codec import *  # noqa: F403
from .errors import *  # noqa: F403
from .frames import *  # noqa: F403
from .group_messages import *  # noqa: F403
from .limits import *  # noqa: F403
from .messages import *  # noqa: F403
from .server_messages import *  # noqa: F403

__all__: list[str] = []
__all__ += client_messages.__all__
__all__ += codec.__all__
__all__ += errors.__all__
__all__ += frames.__all__
__all__ += group_messages.__all__
__all__ += limits.__all__
__all__ += messages.__all__
__all__ += server_messages.__all__
