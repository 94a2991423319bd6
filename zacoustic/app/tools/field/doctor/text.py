"""The report of `zacoustic.app.tools.field.doctor` for people."""

from collections.abc import Iterator

from zacoustic.app.tools.field.doctor.doctor import DoctorReport
from zacoustic.text.safetext import one_line


def as_text(report: DoctorReport) -> str:
    """Return the report as lines."""
    return "\n".join(_lines(report))


def _lines(report: DoctorReport) -> Iterator[str]:
    for finding in report.findings:
        yield one_line(f"! {finding.what}")
        yield one_line(f"  at sea: {finding.why}")
        yield one_line(f"  cure:   {finding.cure}")
        yield ""
    number = len(report.findings)
    looked = ", ".join(report.examined)
    verdict = f"{number} things are wrong" if number > 1 else "one thing is wrong"
    yield (
        f"{report.file}, node {report.address}: "
        f"{verdict if number else 'nothing found'} (looked at: {looked})"
    )
    yield from (one_line(f"not looked at: {each}") for each in report.left_out)
