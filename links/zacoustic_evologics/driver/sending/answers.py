"""The meaning of a command's answer for the frame that waits for it."""

from typing import Final

from zacoustic_evologics.at import replies
from zacoustic_evologics.at.answers import reply_text
from zacoustic_evologics.driver.channel import Answer
from zacoustic_evologics.driver.sending.service import Carriage, Remedy, Service, remedy_for
from zacoustic_evologics.driver.sending.states import Phase, Word

_FREE: Final = ("LISTEN", "ONLINE")
_WORD_OF_REMEDY: Final = {
    Remedy.WAIT: Word.NOT_NOW,
    Remedy.CLEAR: Word.MENDABLE,
    Remedy.LISTEN: Word.MENDABLE,
    Remedy.NONE: Word.REFUSED,
    Remedy.ASK: Word.UNANSWERED,
}


def in_words(reply: replies.CommandReply) -> str:
    """Return the answer in the modem's own words."""
    return reply_text(reply).strip()


def has_time(reply: replies.CommandReply | None) -> bool:
    """Tell whether an answer to `AT?S` means that the modem listens, or is connected."""
    return any(word in replies.state_words(reply) for word in _FREE)


def read_answer(phase: Phase, answer: Answer, carriage: Carriage, counter: int | None) -> Word:
    """Return what an answer means.

    Args:
        phase: Phase of the frame.
        answer: The command and its answer.
        carriage: How the frame is carried.
        counter: Number of a burst.
    """
    reply = answer.reply
    if reply is None:
        return Word.UNANSWERED
    match phase:
        case Phase.CHECKING:
            return Word.LISTENING if has_time(reply) else Word.OCCUPIED
        case Phase.PREPARING:
            is_done = isinstance(reply, replies.Number | replies.Accepted)
            return Word.PREPARED if is_done else _read_refusal(reply)
        case Phase.GIVING:
            return Word.ACCEPTED if isinstance(reply, replies.Accepted) else _read_refusal(reply)
        case Phase.DOUBTING | Phase.POLLING:
            match carriage.service:
                case Service.BURST:
                    return _read_counter(reply, counter)
                case Service.PIGGYBACK:
                    return Word.IDLE if isinstance(reply, replies.Accepted) else Word.HAS_IT
                case _:
                    return _read_delivery(reply)
        case Phase.VERIFYING:
            is_off = isinstance(reply, replies.Number) and reply.value == 0
            return Word.RESTARTED if is_off else Word.DONE
        case _:
            return Word.DONE


def _read_refusal(reply: replies.CommandReply) -> Word:
    if not isinstance(reply, replies.Refused):
        return Word.UNANSWERED
    return _WORD_OF_REMEDY[remedy_for(reply)]


def _read_delivery(reply: replies.CommandReply) -> Word:
    match reply:
        case replies.DeliveryReply():
            under_way = reply.state is replies.DeliveryState.DELIVERING
            return Word.HAS_IT if under_way else Word.IDLE
        case replies.Refused():
            return Word.HAS_IT if reply.kind is replies.RefusalKind.BUSY else Word.IDLE
        case _:
            return Word.UNANSWERED


def _read_counter(reply: replies.CommandReply, counter: int | None) -> Word:
    match reply:
        case replies.Number():
            return Word.HAS_IT if counter is not None and reply.value > counter else Word.IDLE
        case replies.Refused():
            return Word.HAS_IT
        case _:
            return Word.UNANSWERED
