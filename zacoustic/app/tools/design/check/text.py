"""The report of `zacoustic.app.tools.design.check.report` for people."""

from collections.abc import Iterator, Mapping

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.check.bits import SampleBits
from zacoustic.app.tools.design.check.report import Report, StreamRow, TypeRow
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.text.safetext import one_line

_STREAMS = (
    "id", "kind", "name", "type", "from", "to", "priority", "depth", "lifespan", "bytes", "airtime",
)  # fmt: skip
_TYPES = ("type", "fields", "bytes")
_LISTENERS = {"response": "caller", "feedback": "client", "result": "client"}
_BITS = ("id", "name", "type", "smallest", "typical", "largest")
_RIGHT = ("id", "depth", "lifespan", "bytes", "airtime", "fields", *_BITS[3:])


def as_text(report: Report) -> str:
    """Return the report as lines."""
    return "\n".join(_paragraphs(report))


def _paragraphs(report: Report) -> Iterator[str]:
    name = report.nodes.get(report.address)
    own = f"node {report.address}" + (f", {name}" if name else "")
    yield one_line(f"{report.file}: valid; {own}; table {report.digest}")
    for link in report.links:
        reason = link.error.removeprefix(f"{link.locator}: ")
        yield one_line(f"link {link.locator}" + (f": {reason}" if reason else ""))
    if report.wire != WireProfile.NATIVE.value:
        yield f"wire {report.wire}: sizes are those of its packets"
    if report.agreement and len(report.nodes) > 1:
        nodes = f"{len(report.nodes)} nodes"
        advice = "`zacoustic config plan` compares the policies"
        yield f'agreement "{report.agreement}", {nodes}; {advice}'
    if report.access:
        yield one_line(report.access)
    if report.journal:
        yield f"journal {report.journal}"
    if report.forgotten:
        yield report.forgotten
    yield from map(one_line, report.lost_contact)
    if report.streams:
        rows = [_stream_cells(row, report.nodes) for row in report.streams]
        yield ""
        yield align(_STREAMS, rows, right=_RIGHT)
        why = f" ({report.unsaid}; --profile names a modem like it)" if report.unsaid else ""
        yield (
            "bytes: smallest–largest record, stream id included; airtime: of the largest one alone "
            f"in a frame; {report.profile}{why} takes frames of up to {report.mtu_bytes} bytes"
        )
    bits = [_bits_cells(row, row.bits) for row in report.streams if row.bits is not None]
    if bits:
        yield ""
        yield align(_BITS, bits, right=_RIGHT)
        yield (
            "bits of a sample: packed, its payload; dense, what it adds to a string that goes "
            "anyway, at most the whole string; typical: as the fit has measured it, ? if not known"
        )
    if report.types:
        yield ""
        yield align(_TYPES, [_type_cells(row) for row in report.types], right=_RIGHT)
    if report.misfits:
        yield ""
        yield from (f"fails: {misfit}" for misfit in report.misfits)
    if report.notes:
        yield ""
        yield from (one_line(f"note: {note}") for note in report.notes)


def _stream_cells(row: StreamRow, nodes: Mapping[int, str]) -> tuple[str, ...]:
    return (
        str(row.stream_id),
        row.kind,
        row.name,
        row.type or "bytes",
        _receivers(row.sources, nodes, "any"),
        _receivers(row.targets, nodes, _LISTENERS.get(row.kind, "all")),
        row.priority,
        "" if row.depth is None else str(row.depth),
        "" if row.lifespan_s is None else f"{row.lifespan_s:g} s",
        _sizes(row.smallest_bytes, row.largest_bytes),
        f"{row.airtime_s:.3f} s",
    )


def _bits_cells(row: StreamRow, bits: SampleBits) -> tuple[str, ...]:
    return (
        str(row.stream_id),
        row.name if row.kind == "topic" else f"{row.name} {row.kind}",
        row.type or "bytes",
        str(bits.smallest),
        "?" if bits.typical is None else f"{bits.typical:.0f}",
        "no bound" if bits.largest is None else str(bits.largest),
    )


def _type_cells(row: TypeRow) -> tuple[str, ...]:
    return (row.name, str(row.fields), _sizes(row.smallest_bytes, row.largest_bytes))


def _sizes(smallest: int, largest: int | None) -> str:
    if largest is None:
        return f"{smallest}–frame"
    return str(smallest) if smallest == largest else f"{smallest}–{largest}"


def _receivers(addresses: tuple[int, ...] | None, nodes: Mapping[int, str], everybody: str) -> str:
    if addresses is None:
        return everybody
    return ",".join(nodes.get(address, str(address)) for address in addresses)
