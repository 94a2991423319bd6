"""What the site does to a page of docs/, and what it refuses.

- A link out of docs/ leads to the project's source: in the repository such links are relative.
- A page that would load anything from another host fails the build.
"""

import posixpath
import re
from typing import Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.pages import Page

_LOADED: Final = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*\bsrc=["']?(?:https?:)?//[^>]*>"""
    r"""|<link\b(?![^>]*\brel=["']?(?:canonical|prev|next))[^>]*\bhref=["']?(?:https?:)?//[^>]*>"""
)
_OUTWARD: Final = re.compile(r"\]\(((?:\.\./)+[^)#\s]+)((?:#[^)]*)?)\)")


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, **_: object) -> str:
    """Return the page's text with whole addresses for what is not on the site."""

    def whole(found: re.Match[str]) -> str:
        folder = posixpath.dirname(f"docs/{page.file.src_uri}")
        target = posixpath.normpath(posixpath.join(folder, found[1]))
        if target.startswith("docs/"):
            return found[0]
        return f"]({config['repo_url']}/{target}{found[2]})"

    return _OUTWARD.sub(whole, markdown)


def on_post_page(output: str, *, page: Page, **_: object) -> str:
    """Return the page, its search with a name for those who do not see it.

    Raises:
        PluginError: It loads something from another host.
    """
    foreign = _LOADED.findall(output)
    if foreign:
        raise PluginError(f"{page.file.src_uri} loads from another host: {foreign[0]}")
    unnamed = '<div class="md-search" data-md-component="search" role="dialog"'
    return output.replace(unnamed, f'{unnamed} aria-label="search"')
