"""What the console says when something has died: the gateway, the page's server, the link."""

import os
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from tests.auv.browsers import BROWSER, LAPTOP, LIMIT_MS, PHONE, Running, Visitor, console, visit

PICTURES: Final = os.environ.get("ZACOUSTIC_PICTURES", "")
"""Folder into which pictures are taken, for who wants to look at them."""
SAID_WITHIN_S: Final = 3.0

_IS_WANTED: Final = "ZACOUSTIC_BROWSER" in os.environ or os.environ.get("ZACOUSTIC_SOAK") == "1"
pytestmark = [
    pytest.mark.skipif(not _IS_WANTED, reason="make test-browser"),
    pytest.mark.skipif(BROWSER is None, reason="NOT RUN: no Chromium found"),
]


@contextmanager
def dive(viewport: dict[str, int]) -> Iterator[tuple[Running, Visitor]]:
    """Run the console until the vehicle has reported, with nothing in the banner."""
    with (
        console(is_harmed=True) as running,
        visit(running, viewport, is_harmed=True) as (_, visitor),
    ):
        visitor.see("^disarmed$")
        visitor.see("vehicle heard")
        assert visitor.page.locator("#za-banner").is_hidden()
        yield running, visitor


def see_banner(visitor: Visitor, words: str, *, within_s: float = SAID_WITHIN_S) -> float:
    """Wait until the banner says something; gives how long that took, s."""
    begun_s = time.monotonic()
    visitor.page.locator("#za-banner", has_text=re.compile(words)).wait_for(timeout=within_s * 1e3)
    took_s = time.monotonic() - begun_s
    box = visitor.page.locator("#za-banner").bounding_box()
    size = visitor.page.viewport_size
    assert box is not None
    assert size is not None
    assert (box["x"], box["y"], box["width"]) == (0, 0, size["width"])
    colour = visitor.page.locator("#za-banner").evaluate(
        "each => getComputedStyle(each).backgroundColor"
    )
    assert colour == "rgb(196, 15, 28)"
    return took_s


def picture(visitor: Visitor, name: str) -> None:
    if PICTURES:
        visitor.page.screenshot(path=Path(PICTURES) / f"{name}.png")


def orders(visitor: Visitor) -> str:
    found: str = visitor.page.locator(".orders").inner_text()
    return found


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hangs"])
def test_a_gateway_that_is_gone(how: signal.Signals) -> None:
    with dive(LAPTOP) as (running, visitor):
        page = visitor.page
        picture(visitor, "well-1440")
        running.harm(running.child("node1.json5"), how)
        took_s = see_banner(visitor, r"^NOT SENT: gateway gone since \d+ s$")
        print(f"gateway {how.name}: said after {took_s:.1f} s")
        assert page.locator(".chip", has_text="modem").inner_text().startswith("modem not known")
        visitor.see("^disabled: gateway gone$")
        assert page.get_by_role("button", name="arm", exact=True).is_disabled()
        page.locator(".stop").click()
        page.locator(".orders", has_text="NOT SENT: gateway gone").wait_for(
            timeout=SAID_WITHIN_S * 1e3
        )
        picture(visitor, f"gateway-{how.name}-1440")
        page.locator("#za-banner", has_text=re.compile(r"since (1\d|2\d) s")).wait_for(
            timeout=LIMIT_MS
        )
        assert "the vehicle has it" not in orders(visitor)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hangs"])
def test_a_page_server_that_is_gone(how: signal.Signals) -> None:
    with dive(PHONE) as (running, visitor):
        page = visitor.page
        picture(visitor, "well-390")
        running.harm(running.pid, how)
        # Nobody knows yet that it is gone: this waits in the connection.
        page.get_by_role("button", name="arm", exact=True).click()
        took_s = see_banner(visitor, r"^NOT SENT: page server gone since \d+ s")
        print(f"page server {how.name}: said after {took_s:.1f} s")
        age = page.locator(".chip [data-age]").first
        before, said = age.inner_text(), page.locator("#za-banner").inner_text()
        page.get_by_role("button", name="arm", exact=True).click(force=True)
        page.locator(".stop").click()
        page.keyboard.press(" ")
        see_banner(visitor, r"STOP pressed \d+ s ago: NOT SENT, kept until")
        picture(visitor, f"server-{how.name}-390")
        page.wait_for_timeout(2000)
        assert age.inner_text() != before  # it counts by the browser's clock
        assert page.locator("#za-banner").inner_text() != said
        assert page.locator("body.za-gone .why").count() == 1
        if how is signal.SIGKILL:
            return
        os.kill(running.pid, signal.SIGCONT)
        # A stop is never too late, and taken once; nothing else that was pressed meanwhile is done.
        visitor.see("the vehicle reports that it has stopped")
        page.locator("#za-banner").wait_for(state="hidden", timeout=LIMIT_MS)
        assert orders(visitor).count("STOP") == 1
        assert "arm" not in orders(visitor).replace("begin with “arm”", "")


@pytest.mark.parametrize("away_s", [1, 6, 15, 45])
def test_a_stop_while_the_browser_is_offline_is_never_forgotten(away_s: int) -> None:
    with dive(LAPTOP) as (_, visitor):
        page = visitor.page
        page.locator(".stop").click()
        visitor.see("the vehicle reports that it has stopped")
        page.context.set_offline(True)
        page.wait_for_timeout(300)
        page.locator(".stop").click()
        for _ in range(away_s):
            page.wait_for_timeout(1000)
            said, banner, is_gone = page.evaluate(
                """() => [[...document.querySelectorAll('.press')].map((each) => each.textContent),
                  document.getElementById('za-banner').innerText,
                  document.body.classList.contains('za-gone')]"""
            )
            assert len(set(said)) == 1
            assert said[0] in banner
            assert said[0] or not is_gone
        picture(visitor, f"offline-{away_s}-1440")
        page.context.set_offline(False)
        page.locator(".orders", has_text=re.compile("STOP.*STOP", re.DOTALL)).wait_for(
            timeout=LIMIT_MS
        )
        page.locator("#za-banner").wait_for(state="hidden", timeout=LIMIT_MS)
        stopped = "the vehicle reports that it has stopped"
        page.locator(".orders", has_text=re.compile(f"{stopped}.*{stopped}", re.DOTALL)).wait_for(
            timeout=LIMIT_MS
        )
        assert orders(visitor).count("STOP") == 2
        assert page.evaluate("localStorage.length") == 0


def test_a_press_that_nobody_takes_can_be_dismissed() -> None:
    with dive(PHONE) as (running, visitor):
        page = visitor.page
        running.harm(running.pid, signal.SIGSTOP)
        see_banner(visitor, r"^NOT SENT: page server gone")
        page.keyboard.press(" ")
        see_banner(visitor, r"STOP pressed \d+ s ago: NOT SENT, kept until")
        page.get_by_role("button", name="dismiss").click()
        page.locator("#za-banner", has_text="pressed").wait_for(state="detached", timeout=5000)
        os.kill(running.pid, signal.SIGCONT)
        page.locator("#za-banner").wait_for(state="hidden", timeout=LIMIT_MS)
        page.wait_for_timeout(3000)
        assert "STOP" not in orders(visitor)


def test_a_link_that_is_down() -> None:
    with dive(LAPTOP) as (running, visitor):
        page = visitor.page
        running.harm(running.child("run modems evologics"), signal.SIGKILL)
        took_s = see_banner(visitor, r"^NOT SENT: link (down|opening) since \d+ s$")
        print(f"link: said after {took_s:.1f} s")
        page.locator(".stop").click()
        page.locator(".orders", has_text=re.compile("NOT SENT: link")).wait_for(
            timeout=SAID_WITHIN_S * 1e3
        )
        picture(visitor, "link-1440")


def test_on_a_phone_stop_is_on_top_wherever_one_is() -> None:
    with dive(PHONE) as (_, visitor):
        page = visitor.page
        stop: Any = page.get_by_role("button", name="STOP", exact=True)
        for place in (0, 600, 100_000):
            page.evaluate("y => window.scrollTo(0, y)", place)
            box = stop.bounding_box()
            assert box is not None
            assert 0 <= box["y"] < 100
            assert box["x"] >= 0
            assert 340 <= box["width"] <= 390
            assert box["height"] >= 56
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        picture(visitor, "phone-390-bottom")
