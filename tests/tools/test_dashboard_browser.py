"""The dashboard in a real browser, over two gateways on simulated water; `make test-browser`."""

import asyncio
import os
import re
import shutil
import signal
import sys
from asyncio.subprocess import PIPE
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import pytest

from tests.axe import findings_async
from tests.cli.watched import pair
from tests.gateway.networks import LIMIT_S, cbor, run

BROWSER: Final = shutil.which("chromium") or shutil.which("google-chrome")
LIMIT_MS: Final = 60_000

SAID_WITHIN_MS: Final = 3000
PICTURES: Final = os.environ.get("ZACOUSTIC_PICTURES", "")


async def picture(page: Any, name: str) -> None:
    """Take a picture, for who wants to look at it."""
    if PICTURES:
        await page.screenshot(path=Path(PICTURES) / f"{name}.png")


pytestmark = [
    pytest.mark.skipif("ZACOUSTIC_BROWSER" not in os.environ, reason="make test-browser"),
    pytest.mark.skipif(BROWSER is None, reason="NOT RUN: no Chromium found"),
]


def test_page_follows_the_gateway_says_what_is_dead_and_loads_nothing_from_elsewhere() -> None:
    api = pytest.importorskip("playwright.async_api", reason="NOT RUN: no playwright")
    problems: list[str] = []
    asked: set[str] = set()

    async def scene() -> None:
        async with api.async_playwright() as tool, AsyncExitStack() as gateways:
            found = await gateways.enter_async_context(pair())
            where = ["--connect", f"tcp/127.0.0.1:{found.shore_network.port}"]
            command = [sys.executable, "-m", "zacoustic", "dashboard", *where]
            environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
            process = await asyncio.create_subprocess_exec(
                *command, "--listen", "127.0.0.1:0", stdout=PIPE, env=environment
            )
            assert process.stdout is not None
            async with asyncio.timeout(LIMIT_S):
                url = (await process.stdout.readline()).decode().removeprefix("page").strip()
            browser = await tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
            page = await browser.new_page(viewport={"width": 1200, "height": 900})
            page.on("pageerror", lambda error: problems.append(str(error)))
            page.on("request", lambda request: asked.add(request.url))
            for attempt in range(100):
                try:
                    await page.goto(url, wait_until="load", timeout=LIMIT_MS)
                    break
                except api.Error:  # it does not listen yet
                    assert attempt < 99
                    await page.wait_for_timeout(200)

            async def see(text: str) -> None:
                said = page.get_by_text(re.compile(text)).locator("visible=true")  # no SVG title
                await said.first.wait_for(timeout=LIMIT_MS)

            await see("1 gateway on tcp/127.0.0.1")
            await see("1 shore")
            await see("link up")
            payload = cbor(depth=12.5, mode="survey")
            found.auv.put("auv1/nav", payload, encoding="application/cbor")
            await see("← 2: auv1/nav")
            chart = page.locator("svg[aria-label=load] polyline")
            await chart.wait_for(state="attached", timeout=LIMIT_MS)
            assert await page.get_by_text("{sensor}/raw/{node}").count() == 0
            await page.get_by_text("quiet streams as well").click()
            await see(r"\{sensor\}/raw/\{node\}")
            await picture(page, "dashboard-1200")
            assert await findings_async(page) == []
            banner = page.locator("#za-banner")
            assert await banner.is_hidden()

            async def see_banner(words: str) -> None:
                said = page.locator("#za-banner", has_text=re.compile(words))
                await said.wait_for(timeout=SAID_WITHIN_MS)
                box = await banner.bounding_box()
                assert box is not None
                assert (box["x"], box["y"], box["width"]) == (0, 0, page.viewport_size["width"])

            process.send_signal(signal.SIGSTOP)  # it hangs, and its connections stay
            await see_banner(r"^NOT CURRENT: page server gone since \d+ s$")
            age = page.locator("td [data-age]").first
            before = await age.inner_text()
            await page.wait_for_function(
                "([each, text]) => each.textContent !== text",
                arg=[await age.element_handle(), before],
            )
            await page.set_viewport_size({"width": 390, "height": 844})
            await see_banner("page server gone")
            await picture(page, "dashboard-390-server-gone")
            process.send_signal(signal.SIGCONT)
            await banner.wait_for(state="hidden", timeout=LIMIT_MS)
            await gateways.aclose()
            await see_banner("^NOT CURRENT: (gateway 1 shore|the Zenoh router is) gone")
            await picture(page, "dashboard-390-gateway-gone")
            assert await page.evaluate("document.documentElement.scrollWidth") <= 390
            await browser.close()
            process.terminate()
            await process.communicate()

    run(scene(), limit_s=240)
    assert problems == []
    elsewhere = [
        url for url in asked if not re.match(r"(http|ws)://127\.0\.0\.1:|data:|blob:", url)
    ]
    assert elsewhere == []
