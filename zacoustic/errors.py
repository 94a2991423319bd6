"""Every exception that zacoustic raises to its user.

::

    ZacousticError
     ├─ ConfigError (ValueError)       a file or an argument: says file, key, value, what is allowed
     ├─ LocalError                     the caller broke a rule of the API
     │   ├─ PayloadTooLargeError       a payload that fits no frame of this link
     │   ├─ PayloadInvalidError (ValueError)    a value that its type does not allow
     │   ├─ UnknownStreamError         a name or id that the stream table does not have
     │   ├─ QueueFullError             a bounded queue whose policy is to refuse
     │   └─ JournalUnavailableError    it must survive a restart, and cannot be written down
     ├─ DeliveryError                  it did not get there: link down, rejected, expired
     │   ├─ CallTimeoutError (TimeoutError)     no answer before the deadline of a call or range
     │   └─ OutcomeUnknownError        the server ended without an answer; it may have run
     ├─ ServiceError                   the remote handler failed; carries its text
     ├─ SessionError                   Zenoh: router unreachable, port in use
     └─ LinkError
         ├─ LinkUnavailableError       no such link, or its package is not installed
         ├─ LinkOpenError (OSError)    the port or the peer cannot be opened
         ├─ LinkClosedError            used after close, or before open
         └─ RangeUnavailableError      the link measures no ranges, or none to that node

Misbehaviour of a remote node is never an exception: bad receptions are counted, traced
and dropped.

Each error is one line that says what happened, the value, the limit; `hint` says what to do, and
the command line prints it behind the message.
"""


class ZacousticError(Exception):
    """Root of all errors raised to the user.

    Args:
        message: One line: what happened, with the value and the limit.
        hint: What to do about it, or empty.
    """

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message} ({self.hint})" if self.hint else message


class ConfigError(ZacousticError, ValueError):
    """A configuration file, key or value is wrong."""


class LocalError(ZacousticError):
    """The caller broke a rule of the API."""


class PayloadTooLargeError(LocalError):
    """A payload that fits no frame of this link."""


class PayloadInvalidError(LocalError, ValueError):
    """A value that its type does not allow."""


class UnknownStreamError(LocalError):
    """A name or an id that the stream table does not have."""


class QueueFullError(LocalError):
    """A bounded queue is full and its policy is to refuse."""


class JournalUnavailableError(LocalError):
    """The journal cannot be written now, so nothing that must survive a restart is accepted."""


class DeliveryError(ZacousticError):
    """A payload did not reach the other engine."""


class CallTimeoutError(DeliveryError, TimeoutError):
    """No answer arrived before the deadline of the call, or of the range that was asked for."""


class OutcomeUnknownError(DeliveryError):
    """The server ended without an answer: whether it has done its work is unknown."""


class ServiceError(ZacousticError):
    """The remote handler of a service failed; the text is the remote one's."""


class SessionError(ZacousticError):
    """The Zenoh session cannot be opened: router unreachable, port in use."""


class LinkError(ZacousticError):
    """Root of the errors of links."""


class LinkUnavailableError(LinkError):
    """No link of that name, or its package is missing."""


class LinkOpenError(LinkError, OSError):
    """The port, or the peer behind it, cannot be opened."""


class LinkClosedError(LinkError):
    """A link was used before `open` or after `close`."""


class RangeUnavailableError(LinkError):
    """The link measures no ranges, or none to that node."""
