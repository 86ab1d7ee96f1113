"""Meshcat's server, in a thread of this process, for this machine only: its own would listen on every address."""

from __future__ import annotations

import asyncio
import threading
from functools import partial
from queue import SimpleQueue
from typing import Any

from meshcat.servers.zmqserver import ZMQWebSocketBridge

HOST = "127.0.0.1"


class Bridge(ZMQWebSocketBridge):
    """Serves the viewer on the loopback address, as ZMQWebSocketBridge does with the drawing commands."""

    def make_app(self) -> Any:
        app = super().make_app()
        app.listen = partial(app.listen, address=HOST)
        return app


def serve() -> str:
    """Start the server; returns the address for `meshcat.Visualizer(zmq_url=...)`."""
    started: SimpleQueue[str | Exception] = SimpleQueue()
    threading.Thread(target=_run, args=(started,), daemon=True).start()
    answer = started.get()
    if isinstance(answer, Exception):
        raise answer
    return answer


def _run(started: SimpleQueue[str | Exception]) -> None:
    try:
        asyncio.set_event_loop(asyncio.new_event_loop())
        bridge = Bridge(host=HOST)
        started.put(bridge.zmq_url)
    except Exception as error:
        started.put(error)
    else:
        bridge.run()
