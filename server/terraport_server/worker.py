"""Application of a worker process, imported by uvicorn.

Settings come from the environment, under the options of the command line that
:func:`terraport_server.serving.run` put there.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading

from terraport_server.app import create_app
from terraport_server.logging import configure_logging
from terraport_server.serving import WORKER_OPTIONS, connection_class, prepare_process
from terraport_server.settings import Settings

__all__ = ["Connection", "app"]

_settings = Settings(**json.loads(os.environ.get(WORKER_OPTIONS, "{}")))
configure_logging(_settings.log_level, _settings.log_format)

app = create_app(_settings)
Connection = connection_class(app.state.service)
prepare_process()


def _end_with_parent() -> None:
    """Shut down when the parent process ends, so that the port becomes free."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


threading.Thread(target=_end_with_parent, daemon=True).start()
