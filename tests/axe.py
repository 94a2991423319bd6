"""axe-core in a page: what its rules find serious or critical there.

axe-core (MPL-2.0) is no part of this project: npm fetches it when a browser's test wants it.
"""

import json
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, Final

PACKAGE: Final = "axe-core@4"
LIMIT_S: Final = 60.0
RUN: Final = """async () => {
  const grave = (each) => ["serious", "critical"].includes(each.impact);
  const place = (node) => `${node.target.join(" ")}: ${node.failureSummary}`;
  const found = await axe.run(document, { resultTypes: ["violations"] });
  return JSON.stringify(
    found.violations.filter(grave).map((each) => [each.id, each.nodes.map(place)])
  );
}"""


@cache
def source() -> str | None:
    """Return the text of axe-core; None: it cannot be fetched here."""
    npm = shutil.which("npm")
    if npm is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                [npm, "install", "--prefix", folder, "--no-audit", "--no-fund", PACKAGE],
                capture_output=True,
                timeout=LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None
        if done.returncode:
            return None
        return Path(folder, "node_modules/axe-core/axe.min.js").read_text(encoding="utf-8")


def findings(page: Any) -> list[Any]:
    """Return what is serious or critical on a page of playwright's sync API: rule, places.

    Nothing where axe-core cannot be fetched; a test of its own says so.
    """
    text = source()
    if text is None:
        return []
    page.evaluate(text)
    return list(json.loads(page.evaluate(RUN)))


async def findings_async(page: Any) -> list[Any]:
    """Return the same of a page of its async API."""
    text = source()
    if text is None:
        return []
    await page.evaluate(text)
    return list(json.loads(await page.evaluate(RUN)))
