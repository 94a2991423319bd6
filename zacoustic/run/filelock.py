"""Locks on files: one process at a time, and the kernel unlocks them with the process."""


def lock_file(descriptor: int) -> None:
    """Lock an open file for as long as it is open.

    Raises:
        BlockingIOError: Somebody else has locked it.
    """
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows has nothing of the kind
        return
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
