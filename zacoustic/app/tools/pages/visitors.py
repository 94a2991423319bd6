"""Visitors of our pages who leave before their answer."""

from zacoustic.run.web.gatekeeper import Application, Message, Receive, Send


class Visitors:
    """Wraps an ASGI application: ignores visitors that leave before their answer.

    Args:
        application: Answers requests.
    """

    def __init__(self, application: Application) -> None:
        self._application = application

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer one request.

        An error of the answer shows with visitors that stay.
        """
        has_left = has_begun = False

        async def hear() -> Message:
            nonlocal has_left
            message = await receive()
            has_left = has_left or message["type"] == "http.disconnect"
            return message

        async def say(message: Message) -> None:
            nonlocal has_begun
            has_begun = True
            await send(message)

        try:
            await self._application(scope, hear, say)
        except Exception:  # of any framework: writing to a visitor that left may raise anything
            if has_begun or not has_left:
                raise
