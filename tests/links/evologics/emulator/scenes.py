"""What two modems and their hosts do in each transcript of the emulator, and how it is written.

To write the files anew, after looking at why they differ:
``python -m tests.links.evologics.emulator.scenes``
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.links.evologics.emulator.sea import Host, Sea
from tests.links.evologics.transcript import expression
from zacoustic_evologics import AtDecoder, CommandDecoder, Framing, Interpreter
from zacoustic_evologics.at.firmware import Firmware
from zacoustic_evologics.at.framing import CRLF, TCP_LINE_END
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.emulator import (
    Behaviour,
    FaultKind,
    FaultPlan,
    PortBytes,
    ScriptedFault,
)

FOLDER: Final = Path(__file__).parents[3] / "golden" / "evologics"


class Scene:
    """Two modems, and what is said on one port of one of them.

    Args:
        shown: Address of the modem whose port is written down.
        remark: What the file begins with.
        interpreter: Who reads.
        faults: What goes wrong.
        firmware: Of all modems.
        spacing_m: From each modem to the next.
    """

    def __init__(
        self,
        shown: int,
        remark: str,
        interpreter: Interpreter = Interpreter.NET,
        faults: tuple[ScriptedFault, ...] = (),
        *,
        firmware: Firmware = "1.9",
        spacing_m: float = 150.0,
    ) -> None:
        self.sea = Sea(
            3,
            spacing_m=spacing_m,
            interpreter=interpreter,
            faults=FaultPlan(script=faults),
            behaviour=Behaviour(firmware=firmware),
        )
        self.hosts = {address: self.sea.host(address) for address in (1, 2, 3)}
        is_net = interpreter is Interpreter.NET
        self.framing = Framing.LINES if is_net else Framing.PACKETS
        self._commands = CommandDecoder(interpreter, self.framing)
        self._messages = AtDecoder(self.framing)
        self._shown = shown
        self._lines = [f"# {remark}", f"@ {self.framing.value}"]
        self._written = 0

    @property
    def shown(self) -> Host:
        return self.hosts[self._shown]

    def say(self, text: str, address: int | None = None, *, has_end: bool = True) -> None:
        """Say a command, or raw data without an end, on the port that is shown or another one."""
        content = text.encode("latin-1") + (TCP_LINE_END if has_end else b"")
        host = self.hosts[address or self._shown]
        if host is self.shown:
            self._write_down(">" if has_end else ">.", text.encode("latin-1"))
            messages = self._commands.feed(content)
            self._lines += [f"= {expression(message)}" for message in messages]
        host.say(content)
        self._collect()

    def wait(self, seconds: float = 8.0) -> None:
        self.sea.wait(seconds)
        self._collect()

    def text(self) -> str:
        return "\n".join(self._lines) + "\n"

    def _collect(self) -> None:
        for _, output in self.sea.outputs[self._written :]:
            if isinstance(output, PortBytes) and output.port_id == self.shown.port_id:
                self._write_reply(output.content)
        self._written = len(self.sea.outputs)

    def _write_reply(self, content: bytes) -> None:
        messages = self._messages.feed(content)
        is_raw = any(isinstance(message, RawData) for message in messages)
        is_one = len(messages) == 1 and not is_raw
        body = content.removesuffix(CRLF)
        if is_one and body != content:
            self._write_down("<", body)
        else:
            self._write_down("<." if is_raw else "~<.", content)
        self._lines += [f"= {expression(message)}" for message in messages]

    def _write_down(self, mark: str, content: bytes) -> None:
        text = content.decode("latin-1").encode("unicode_escape").decode("ascii")
        self._lines.append(f"{mark} {text}")


def sender() -> Scene:
    scene = Scene(1, "Emulated: everything that is sent, all notifications on, as lines.")
    for option in ("@CTRL", "@ZX1", "@ZU1", "@ZF1", "!RI0", "!RC0", "?CLOCK", "?S", "&V"):
        scene.say("AT" + option)
    scene.say("AT*SENDIM,p0,4,2,ack,test")
    scene.wait()
    for query in ("?T", "?E", "?I", "?V", "?P", "?DI", "?UP", "?UPX", "?PC", "?NOISE"):
        scene.say("AT" + query)
    scene.say("AT*SENDIM,5,255,noack,a,b,c")
    scene.say("AT?DI")
    scene.wait()
    scene.say("AT*SENDIMS,4,2,,ping")
    scene.wait()
    scene.say("AT*SENDIMS,4,2,0,late")
    clock_us = scene.sea.fleet.now // 1000 + 1_081_790_008
    for text in ("once", "more"):
        scene.say(f"AT*SENDIMS,4,2,{(clock_us + 2_000_000) % 2**32},{text}")
    scene.wait()
    scene.say("AT*SENDPBM,2,2,go")
    scene.say("AT*SENDPBM,2,2,no")
    scene.say("AT*SENDIM,1,2,ack,x")
    scene.say("AT*SENDIM,1,2,ack,y")
    scene.say("ATZ3")
    scene.wait()
    scene.say("AT*SEND,8,2,burst\r\n!")
    scene.wait(0.5)
    scene.say("AT?S")
    scene.wait()
    scene.say("AT*SENDPROBE,1,0,")
    scene.wait()
    scene.say("AT!AR2")
    scene.say("ATS", 2)
    scene.say("AT*SENDIM,1,2,ack,x")
    scene.wait()
    scene.say("AT?DI")
    scene.say("AT*SEND,1,2,x")
    scene.wait()
    for mistake in ("*SENDIM,4,2,ack,test!", "*SENDIM,1,77,ack,x", "!L4", "?QQ", "@QQ1", "Q"):
        scene.say("AT" + mistake)
    for act in ("", "I0", "I1", "I2", "I7", "N", "S", "P", "*SENDIM,1,2,ack,x", "A", "Z1", "Z4"):
        scene.say("AT" + act)
    for act in ("!UT1700000000", "?UT", "D2", "H1", "&W", "&F", "?S$", "%SYNC,1", "Z0"):
        scene.say("AT" + act)
    return scene


def firmware_1_6() -> Scene:
    scene = Scene(2, "Emulated: firmware 1.6, its settings and what is received.", firmware="1.6")
    for command in ("I0", "I1", "&V", "@CTRL", "@ZA1", "@ZX1", "@ZF1"):
        scene.say("AT" + command)
    scene.say("AT*SENDIM,5,2,ack,hello", 1)
    scene.wait()
    scene.say("AT*SENDIM,4,1,ack,test")
    scene.wait()
    scene.say("AT*SENDIM,12,255,noack,\r\nRECVSTART\r", 1)
    scene.wait()
    scene.say("AT*SENDPBM,7,2,lowprio", 1)
    scene.say("AT*SENDIM,1,1,ack,x")
    scene.wait()
    scene.say("AT*SENDIMS,4,2,,ping", 1)
    scene.wait()
    scene.say("AT*SEND,5,2,burst", 1)
    scene.wait()
    return scene


def source_level() -> Scene:
    scene = Scene(1, "Emulated: the source level follows from how it is heard.", spacing_m=1500.0)
    for command in ("@ZX1", "!LC1", "?L"):
        scene.say("AT" + command)
    for text in ("a", "b", "c"):
        scene.say(f"AT*SENDIM,1,2,ack,{text}")
        scene.wait()
    scene.say("AT?L")
    return scene


def receiver() -> Scene:
    faults = (ScriptedFault(kind=FaultKind.EFAULT, at_s=50.0, modem=2),)
    scene = Scene(2, "Emulated: everything that is received, as lines.", faults=faults)
    for option in ("@ZX1", "@ZU1"):
        scene.say("AT" + option)
    scene.say("AT*SENDPBM,7,1,lowprio")
    scene.say("AT*SENDIM,5,2,ack,hello", 1)
    scene.wait()
    scene.say("AT@ZF1")
    for command in ("IM,12,2,noack,\r\nRECVSTART\r", "IMS,4,2,,ping", "PROBE,1,0,"):
        scene.say("AT*SEND" + command, 1)
        scene.wait()
    scene.say("AT*SENDPBM,3,2,abc", 1)
    scene.say("AT*SENDIM,1,2,force,x", 1)
    scene.wait()
    scene.say("AT*SEND,6,2,ab\r\ncd", 1)
    scene.wait()
    scene.say("AT*SENDIM,6,3,ack,others", 1)
    scene.wait()
    scene.say("AT!RP1")
    scene.say("AT*SENDIM,6,3,noack,others", 1)
    scene.wait()
    scene.say("AT*SENDIM,3,2,noack,one", 1)
    scene.say("AT*SENDIM,3,2,noack,two", 3)
    scene.wait()
    scene.say("AT@ZA1")
    scene.wait(1.5)
    scene.say("AT@ZA0")
    return scene


def data_mode() -> Scene:
    scene = Scene(1, "Emulated: data mode, packets and raw data.", Interpreter.AT)
    scene.say("+++AT?MODE")
    scene.say("not for anybody", has_end=False)
    for option in ("@ZX1", "!AR2", "?AL", "?S", "?P", "&V"):
        scene.say("+++AT" + option)
    scene.say("+++AT!AR1", 2)
    scene.say("raw data ++ of a burst\r\n", has_end=False)
    scene.wait()
    scene.say("an answer", 2)
    scene.wait()
    scene.say("+++AT*SENDIM,4,2,ack,test")
    scene.wait()
    scene.say("+++AT*SENDIM,21,1,ack,\r\n+++AT:9:RECVSTART\r\n", 2)
    scene.wait()
    for query in ("*SENDIM,4,2,ack,test!", "I", "Z1", "?T", "?ZE", "?ZD", "@ZD"):
        scene.say("+++AT" + query)
    return scene


SCENES: Final[dict[str, Callable[[], Scene]]] = {
    "emulated_sender": sender,
    "emulated_receiver": receiver,
    "emulated_data_mode": data_mode,
    "emulated_firmware_1_6": firmware_1_6,
    "emulated_source_level": source_level,
}
"""By the name of the file."""

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, scene_of in SCENES.items():
        (FOLDER / f"{name}.txt").write_text(scene_of().text(), encoding="ascii")
