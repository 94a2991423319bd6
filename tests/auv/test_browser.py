"""The console in a real browser, with everything behind it in real time.

`make test-browser` steers the vehicle by mouse and keys, `make screenshot` takes the picture of the
README, and in `make soak` somebody sits at the page for ten minutes.
"""

import os
import statistics
import time
from pathlib import Path
from typing import Any, Final

import pytest

from tests.auv.browsers import BROWSER, LIMIT_MS, Visitor, console, visit
from tests.axe import findings

PICTURE: Final = os.environ.get("ZACOUSTIC_SCREENSHOT", "")
SOAK_S: Final = 600.0
SAMPLE_S: Final = 10.0
HEAP_GROWTH_MOST: Final = 1.5e6
"""Of the page's JavaScript heap after a collection, from minute 2…4 to the last two, bytes."""
RSS_GROWTH_MOST: Final = 6e6
"""Of the server's memory, the same."""

_IS_WANTED: Final = "ZACOUSTIC_BROWSER" in os.environ or os.environ.get("ZACOUSTIC_SOAK") == "1"
pytestmark = [
    pytest.mark.skipif(not _IS_WANTED, reason="make test-browser"),
    pytest.mark.skipif(BROWSER is None, reason="NOT RUN: no Chromium found"),
]


@pytest.mark.skipif(bool(PICTURE), reason="the picture is wanted alone")
def test_sliders_and_keys_move_the_vehicle_and_stop_stops_it() -> None:
    with console() as running, visit(running) as (_, visitor):
        page = visitor.page
        visitor.see("^disarmed$")
        still = visitor.drawing("map")
        visitor.click("arm")
        visitor.see("^done$")
        visitor.drag("thrust", 0.9)
        visitor.see(r"^\+2\d N$")
        visitor.see("the vehicle has it")
        visitor.see("^manual$")
        visitor.see(r"^(0\.[3-9]|[1-9]\.)\d* m/s$")
        assert visitor.drawing("map") != still
        # The button has the focus, and the slider had it: the keys are ours all the same.
        for key in (*["ArrowRight"] * 5, "ArrowLeft", "ArrowUp", "-"):
            page.keyboard.press(key)
        visitor.see(r"^\+4 °$")
        visitor.see("^-1 °$")
        visitor.see(r"^\+([1-9]\.\d|0\.5) °/s$")
        north, east = (page.get_by_label(name) for name in ("north m", "east m"))
        click_on_map(visitor, 0.9, 0.2)
        page.wait_for_function("field => field.value !== '60'", arg=north.element_handle())
        assert int(north.input_value()) > 10
        assert int(east.input_value()) > 10
        page.get_by_label("depth m").fill("8")
        visitor.click("go to")
        visitor.see("accepted, under way, about .* m left")
        visitor.see("^goto$")
        visitor.see("8 m deep")
        page.get_by_role("button", name="arm", exact=True).focus()
        page.keyboard.press(" ")
        visitor.see("^stopped$")
        visitor.see("the vehicle reports that it has stopped")
        orders = page.locator(".orders").inner_text()
        assert (orders.count("arm\n"), orders.count("STOP\n")) == (1, 1)


@pytest.mark.skipif(bool(PICTURE), reason="the picture is wanted alone")
def test_nothing_at_the_console_is_a_serious_barrier() -> None:
    with console() as running, visit(running) as (_, visitor):
        visitor.see("^disarmed$")
        assert findings(visitor.page) == []


def click_on_map(visitor: Visitor, across: float, down: float) -> None:
    """Click at shares of its width and height."""
    # The drawing in it is another one twice a second.
    box = visitor.page.locator(".drawing.map").bounding_box()
    assert box is not None
    visitor.page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])


@pytest.mark.skipif(not PICTURE, reason="make screenshot")
@pytest.mark.timeout(1200)
def test_screenshot() -> None:
    """Dive, take a photo, ask for another, and take the picture while the vehicle turns."""
    with console() as running, visit(running) as (_, visitor):
        page = visitor.page
        visitor.see("^disarmed$")
        visitor.click("arm")
        visitor.see("^done$")
        page.get_by_label("depth m").fill("12")
        page.get_by_label("north m").fill("110")
        page.get_by_label("east m").fill("90")
        visitor.click("go to")
        visitor.see("^goto$")
        visitor.click("photo")
        visitor.see(r" kB", limit_ms=180_000)
        page.locator("img[alt=photo]").wait_for(timeout=900_000)
        page.get_by_label("north m").fill("-40")
        page.get_by_label("east m").fill("170")
        page.get_by_label("depth m").fill("20")
        visitor.click("go to")
        visitor.see("accepted, under way", limit_ms=180_000)
        visitor.click("photo")
        visitor.see(r"[1-9]\.\d of .* kB", limit_ms=180_000)
        page.mouse.move(5, 5)
        page.screenshot(path=PICTURE)
        visitor.click("STOP")
        visitor.see("the vehicle reports that it has stopped")


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_ten_minutes_at_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    """No word of complaint in the browser's log, and the memory of both ends stays what it is.

    Somebody steers all the time, a photo comes up, and every minute another page is opened and
    closed again.
    """
    heap: list[float] = []
    rss: list[float] = []
    with console() as running, visit(running) as (browser, visitor):
        visitor.see("^disarmed$")
        visitor.click("arm")
        visitor.see("^done$")
        visitor.click("photo")
        tool = visitor.page.context.new_cdp_session(visitor.page)
        tool.send("Performance.enable")
        begun_s, step = time.monotonic(), 0
        while time.monotonic() - begun_s < SOAK_S:
            steer(visitor, step)
            if step % 6 == 5:
                other = Visitor(browser, running.address)
                other.open()
                other.see("probably now", limit_ms=LIMIT_MS)
                other.page.close()
                visitor.problems += other.problems
            heap.append(heap_bytes(tool))
            rss.append(running.rss_bytes)
            step += 1
            visitor.page.wait_for_timeout(
                max(0.0, step * SAMPLE_S - time.monotonic() + begun_s) * 1e3
            )
        visitor.page.keyboard.press(" ")
        visitor.see("the vehicle reports that it has stopped")
    heap_growth, rss_growth = growth(heap), growth(rss)
    with capsys.disabled():
        print(
            f"\nten minutes: heap {heap[-1] / 1e6:.1f} MB, grown by {heap_growth / 1e6:+.2f} MB; "
            f"server {rss[-1] / 1e6:.0f} MB, grown by {rss_growth / 1e6:+.2f} MB"
        )
        if path := os.environ.get("ZACOUSTIC_SOAK_LOG"):
            Path(path).write_text(
                "\n".join(f"{a:.0f} {b:.0f}" for a, b in zip(heap, rss, strict=True))
            )
    assert heap_growth < HEAP_GROWTH_MOST
    assert rss_growth < RSS_GROWTH_MOST


def steer(visitor: Visitor, step: int) -> None:
    """Do something that is done at such a page."""
    match step % 4:
        case 0:
            visitor.click("by hand")
            visitor.drag("thrust", 0.6 + 0.1 * (step % 3))
        case 1:
            for _ in range(5):
                visitor.page.keyboard.press("ArrowRight" if step % 8 < 4 else "ArrowLeft")
        case 2:
            visitor.click("hold")
        case _:
            share = 0.2 + 0.1 * (step % 7)
            click_on_map(visitor, share, share)
            visitor.click("go to")


def heap_bytes(tool: Any) -> float:
    """Return what the page's JavaScript holds when the rubbish is gone."""
    tool.send("HeapProfiler.collectGarbage")
    metrics = tool.send("Performance.getMetrics")["metrics"]
    found: float = next(each["value"] for each in metrics if each["name"] == "JSHeapUsedSize")
    return found


def growth(samples: list[float]) -> float:
    """Return by how much the last fifth is more than that from the second minute to the fourth."""
    fifth = len(samples) // 5
    return statistics.median(samples[-fifth:]) - statistics.median(samples[fifth : 2 * fifth])
