"""The report of `zacoustic.tools.doctor` for people."""

from collections.abc import Iterator

from zacoustic.tools.doctor.doctor import DoctorReport


def as_text(report: DoctorReport) -> str:
    """Return the report as lines."""
    return "\n".join(_lines(report))


def _lines(report: DoctorReport) -> Iterator[str]:
    for finding in report.findings:
        yield f"! {finding.what}"
        yield f"  at sea: {finding.why}"
        yield f"  cure:   {finding.cure}"
        yield ""
    number = len(report.findings)
    looked = ", ".join(report.examined)
    verdict = f"{number} things are wrong" if number > 1 else "one thing is wrong"
    yield (
        f"{report.file}, node {report.address}: "
        f"{verdict if number else 'nothing found'} (looked at: {looked})"
    )
    yield from (f"not looked at: {each}" for each in report.left_out)
