"""Services of ROS 2: CDR and attachments, under the keys of rmw_zenoh.

A client of rmw_zenoh asks all servers that are complete, and only logs error replies; so it notices
a failure by its own time limit. Several local servers do no harm: the gateway asks one of them.
"""

from collections.abc import Sequence

from zacoustic.core.base.clock import Clock
from zacoustic.core.engine.events import CallKey
from zacoustic.core.streams.table import Stream
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.names import RosKey
from zacoustic.ros.streams import SERVICE_QOS, RosService
from zacoustic.ros.tokens import Entity
from zacoustic.zenoh.gateway.dialect.dialects import Declared, ServiceDialect
from zacoustic.zenoh.gateway.dialect.ros.graph import Graph
from zacoustic.zenoh.gateway.dialect.ros.topics import CDR, Teller


class ServiceEnds:
    """Both local ends of one service: the attachments of queries and replies.

    Args:
        name: Its name, without a leading slash.
        service: Its ROS side.
        graph: Its endpoints.
        wall_clock: Returns UTC, ns since 1970.
    """

    def __init__(self, name: str, service: RosService, graph: Graph, wall_clock: Clock) -> None:
        self.key: RosKey = service.key(graph.domain, name)
        self._graph = graph
        self._wall_clock = wall_clock
        self._server = Teller(graph.endpoint(Entity.SERVER, self.key, SERVICE_QOS), wall_clock)
        self._client = Teller(graph.endpoint(Entity.CLIENT, self.key, SERVICE_QOS), wall_clock)

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether the gid beside a call belongs to a gateway."""
        read = read_attachment(attachment)
        return read is not None and self._graph.is_gateway(read.gid)

    def answer_mark(self, asked: bytes | None) -> bytes:
        """Return the attachment of an answer: number and gid of the query."""
        read = read_attachment(asked) if asked is not None else None
        if read is None:
            return self._server.attachment()
        return Attachment(
            sequence=read.sequence, stamp_ns=self._wall_clock(), gid=read.gid
        ).encode()

    def question_mark(self) -> bytes:
        """Return the attachment of the next query."""
        return self._client.attachment()

    def offer(self) -> Sequence[Declared]:
        """Announce a server; in the worker."""
        return self._graph.announce([self._server.token])

    def use(self) -> Sequence[Declared]:
        """Announce a client; in the worker."""
        return self._graph.announce([self._client.token])


class RosServiceDialect(ServiceDialect):
    """One service.

    Args:
        stream: The service.
        service: Its ROS side.
        graph: Its endpoints.
        wall_clock: Returns UTC, ns since 1970.
    """

    def __init__(
        self, stream: Stream, service: RosService, graph: Graph, wall_clock: Clock
    ) -> None:
        super().__init__(stream)
        self._service = service
        self.ends = ServiceEnds(stream.name, service, graph, wall_clock)
        self._key = str(self.ends.key)

    @property
    def key(self) -> str:
        """The key of rmw_zenoh."""
        return self._key

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether the gid beside a call belongs to a gateway."""
        return self.ends.is_marked(attachment)

    def read_request(self, payload: bytes, encoding: object) -> tuple[object, str]:
        """Read CDR."""
        return self._service.request.read(payload)[0], CDR

    def write_response(self, value: object, encoding: str) -> tuple[bytes, str]:
        """Write CDR."""
        return self._service.response.write(value), CDR

    def write_request(self, value: object) -> tuple[bytes, str]:
        """Write CDR."""
        return self._service.request.write(value), CDR

    def read_response(self, payload: bytes, encoding: object) -> object:
        """Read CDR."""
        return self._service.response.read(payload)[0]

    def answer_mark(self, asked: bytes | None) -> bytes:
        """Return number and gid of the query."""
        return self.ends.answer_mark(asked)

    def question_mark(self, call: CallKey) -> bytes:
        """Return a number, and the gid of the gateway's client."""
        return self.ends.question_mark()
