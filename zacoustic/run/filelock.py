"""Locks on files: one process holds each, and the kernel releases it when the process ends."""


def lock_file(descriptor: int) -> None:
    """Lock an open file until it is closed.

    Raises:
        BlockingIOError: Another process holds the lock.
    """
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows has no `fcntl`
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
