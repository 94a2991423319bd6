"""The verb `zacoustic service call`."""

from typing import Any

from zacoustic.app.cli.support.participant import Participant, class_of, read_request
from zacoustic.app.cli.support.rows import seconds, word


class Call(Participant):
    r"""Call a service, on Zenoh or straight on a link.

    Examples:
      zacoustic service call auv1/arm '{ on: true }' --connect tcp/127.0.0.1:7447
      zacoustic service call auv1/arm '{ on: true }' --link sim/127.0.0.1:7000 \
        --config fleet.json5 --timeout 30
    """

    key: str = word("SERVICE", "service of the config, or key")
    request: str = word("REQUEST", "JSON5 for a typed service, otherwise a text", "?", default="")
    timeout: float | None = seconds(
        "how long to wait for the answer, s (default: the config's, or 60)"
    )

    async def work(self) -> None:
        """Call and print the answer.

        Raises:
            ServiceError, DeliveryError: There is no response.
            CallTimeoutError: None comes in time.
        """
        from zacoustic.zenoh.node.api.text import read_untyped

        async with self.make_node() as node:
            stream = node.find_stream(self.key)
            types: tuple[Any, Any] = (bytes, bytes)
            if stream is None:
                request, _ = read_untyped(self.request, source="REQUEST")
            else:
                request = read_request(stream, self.request, source="REQUEST")
                types = (class_of(stream.type), class_of(stream.response_type))
            client = node.create_client(types, self.key)
            response = await client.call(request, timeout_s=self.timeout)
        self.print_value({"key": self.key}, response)
