"""Stop and disarm from another computer, with confirmation of standstill.

A separate connection makes it independent of the stream, which may be stale. The outcome is known
within a second: the arm stands, was not reached, or is not confirmed at standstill yet.
"""

import asyncio
from pathlib import Path
from typing import Final, Literal

import msgspec

from common.errors import ContactdError
from daemon.modes.table import Mode
from daemon.protocol.replies import Reply
from daemon.protocol.requests import GetStatus, bare
from programs.clients.link import Link

WITHIN_S: Final = 0.8  # part of the second; the network takes the rest
_LOOKS_EVERY_S: Final = 0.05
STANDS: Final = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})
Command = Literal["stop", "disarm"]
Outcome = Literal["stands", "disarmed", "not seen to stand", "refused", "not reached"]


class Stopped(msgspec.Struct, frozen=True):
    """Outcome of a stop or disarm, with a remark in words."""

    outcome: Outcome
    text: str
    mode: str = ""


async def carry_out(path: Path, command: Command, on_behalf_of: str) -> Stopped:
    """Send the command through the view socket, and poll until the arm stands."""
    request = bare(command, on_behalf_of)
    last: Reply | None = None  # first the command's own reply, which shows that it arrived
    try:
        async with asyncio.timeout(WITHIN_S), await Link.open(path) as link:
            reply = await link.ask(request, WITHIN_S)
            if not reply.ok:
                return Stopped("refused", reply.refusal)
            last = reply
            while not _done(command, last):
                await asyncio.sleep(_LOOKS_EVERY_S)
                last = _as_reply(await link.ask(GetStatus(), WITHIN_S))
            return Stopped("stands" if _stands(last) else "disarmed", "", str(last.mode))
    except (ContactdError, TimeoutError) as error:
        if last is None:
            return Stopped("not reached", str(error) or "the daemon does not answer in time")
        joints = ", ".join(last.unproved)
        return Stopped("not seen to stand", joints or f"the arm is {last.mode}", str(last.mode))


def _done(command: Command, reply: Reply) -> bool:
    """True if there is nothing more to wait for. A disarmed arm may continue its trajectory."""
    if command == "disarm" and not reply.unproved and reply.mode != Mode.STOPPING:
        return True
    return _stands(reply)


def _stands(reply: Reply) -> bool:
    return reply.mode in STANDS and not reply.unproved


def _as_reply(reply: Reply) -> Reply:
    """Reply to a stop made from the mode and unproved joints of a Status."""
    status = reply.status
    if status is None:
        return reply
    return Reply(ok=True, mode=status.mode, armed=status.armed, unproved=status.unproved)
