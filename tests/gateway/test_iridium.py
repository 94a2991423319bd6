"""A vehicle and its shore over emulated Iridium: two gateways and the emulator, a process each."""

import json
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh

from tests.gateway.networks import free_port, get, hear, matched, run, zenoh_config, zenoh_settings
from tests.gateway.test_command import notice, running

SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv"}],
    "streams": [
        {"id": 1, "topic": "auv/report", "publishers": [2], "reliability": "reliable"},
        {"id": 2, "topic": "auv/plan", "publishers": [1], "reliability": "reliable"},
    ],
}
SETTINGS: Final = "max_bytes_per_day=5000&session_s=0.5&price=0.16"


def _write(path: Path, listen: int) -> Path:
    settings = json.loads(zenoh_settings("router", listen=listen))
    settings["plugins_loading"] = {"enabled": False}
    settings["plugins"] = {"acoustic": {"__required__": False, **SECTION}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def test_samples_cross_by_satellite_and_are_paid_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore_port = free_port()
            emulator = await stack.enter_async_context(
                running(
                    *("run", "modems", "iridium", "--modems", 1, "--listen", "127.0.0.1:0"),
                    *("--shore", f"127.0.0.1:{shore_port}", "--session", 0.1, 0.3, "--json"),
                )
            )
            modem = await notice(emulator, "listening")
            gateway = (await notice(emulator, "directip"))["place"]
            on_shore = f"&gateway={gateway}&imei={modem['imei']}"
            links = {
                1: f"iridium/directip:127.0.0.1:{shore_port}#{SETTINGS}{on_shore}",
                2: f"iridium/{modem['locator']}#{SETTINGS}",
            }
            sessions = {}
            for address, link in links.items():
                port = free_port()
                file = _write(tmp_path / f"{address}.json5", port)
                process = await stack.enter_async_context(
                    running("run", "gateway", file, "--address", address, "--link", link, "--json")
                )
                await notice(process, "started")
                settings = zenoh_config("client", connect=port)
                sessions[address] = stack.enter_context(zenoh.open(settings))
            reports, plans = (
                await hear(sessions[1], "auv/report"),
                await hear(sessions[2], "auv/plan"),
            )
            await matched(sessions[2], "auv/report")
            await matched(sessions[1], "auv/plan")
            sessions[2].put("auv/report", b"at the surface")
            assert await reports.payload() == b"at the surface"
            sessions[1].put("auv/plan", b"dive again")
            assert await plans.payload() == b"dive again"
            about = "@acoustic/2/link"
            readings = json.loads((await get(sessions[2], about)).payload(about))["diagnostics"]
            assert readings["spent_bytes"] >= 50
            assert readings["spent_money"] == pytest.approx(readings["spent_bytes"] / 50 * 0.16)

    run(main())
