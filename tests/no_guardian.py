"""No guardian: stands for that of a session in its caller's process: most tests' devices are known to no other process."""


def watch(session: object) -> None:
    """Start none."""
