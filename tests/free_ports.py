"""Free ports of this machine, for servers that a test starts."""

from __future__ import annotations

import socket


def free_port() -> int:
    """Return the number of a TCP port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])
