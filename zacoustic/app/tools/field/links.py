"""The installed links in words."""

from collections.abc import Iterable

from zacoustic.link.registry import LinkDescription


def describe_as_text(links: Iterable[LinkDescription]) -> str:
    """Return a paragraph for each link: its summary, its settings, or why it is not usable."""
    return "\n\n".join("\n".join(_lines(link)) for link in links)


def _lines(link: LinkDescription) -> Iterable[str]:
    yield f"{link.name}  ({link.package})"
    if link.error:
        yield f"  not usable: {link.error}"
        return
    yield f"  {link.summary}"
    if link.settings:
        written = "  ".join(f"{name}={value}" for name, value in link.settings.items())
        yield f"  settings: {written}"
