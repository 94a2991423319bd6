"""What the site does to a page of docs/: a link out of docs/ leads to the project's source.

The pages are read in the repository as well, where such links are relative.
"""

import posixpath
import re
from typing import Any, Final

_OUTWARD: Final = re.compile(r"\]\(((?:\.\./)+[^)#\s]+)((?:#[^)]*)?)\)")


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """Return the page's text with whole addresses for what is not on the site."""

    def whole(found: re.Match[str]) -> str:
        folder = posixpath.dirname(f"docs/{page.file.src_uri}")
        target = posixpath.normpath(posixpath.join(folder, found[1]))
        if target.startswith("docs/"):
            return found[0]
        return f"]({config['repo_url']}/{target}{found[2]})"

    return _OUTWARD.sub(whole, markdown)
