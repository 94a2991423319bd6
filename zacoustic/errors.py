"""The exceptions that zacoustic raises to its users.

::

    ZacousticError
     ├─ ConfigError (ValueError) a file or an argument; has file, key, value, allowed values ├─
     LocalError the caller broke a rule of the API │ ├─ PayloadTooLargeError a payload that fits no
     frame of this link │ ├─ PayloadInvalidError (ValueError) a value that its type does not allow │
     ├─ UnknownStreamError a name or id that the stream table does not have │ ├─ QueueFullError a
     bounded queue whose policy is to refuse │ └─ JournalUnavailableError the journal cannot store
     what must survive a restart ├─ DeliveryError a payload did not arrive: link down, rejected,
     expired │ ├─ CallTimeoutError (TimeoutError) no answer before the deadline of a call or range │
     └─ OutcomeUnknownError the server ended without an answer; it may have run ├─ ServiceError the
     remote handler failed; carries its text ├─ SessionError Zenoh: router unreachable, port in use
     └─ LinkError
         ├─ LinkUnavailableError       no such link, or its package is not installed
         ├─ LinkOpenError (OSError)    the port or the peer cannot be opened
         ├─ LinkClosedError            used after close, or before open
         └─ RangeUnavailableError      the link measures no ranges, or none to that node

Misbehaviour of a remote node never raises: bad receptions are counted, traced and dropped.

Each error is one line with what happened, the value and the limit; `hint` says what to do, and the
command line prints it after the message.
"""


class ZacousticError(Exception):
    """Root of all errors raised to the user.

    Args:
        message: One line: what happened, with the value and the limit.
        hint: What to do, or empty.
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
    """No answer arrived before the deadline of a call or of a range measurement."""


class OutcomeUnknownError(DeliveryError):
    """The server ended without an answer: whether it has done its work is unknown."""


class ServiceError(ZacousticError):
    """The remote handler of a service failed; the text is the handler's."""


class SessionError(ZacousticError):
    """The Zenoh session cannot be opened: router unreachable, port in use."""


class LinkError(ZacousticError):
    """Root of the errors of links."""


class LinkUnavailableError(LinkError):
    """There is no link of that name, or its package is missing."""


class LinkOpenError(LinkError, OSError):
    """The port, or the peer behind it, cannot be opened."""


class LinkClosedError(LinkError):
    """A link was used before `open` or after `close`."""


class RangeUnavailableError(LinkError):
    """The link measures no ranges, or none to that node."""
