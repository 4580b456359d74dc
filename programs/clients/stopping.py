"""Stop and disarm from elsewhere, with confirmation of standstill, independent of the stream.

Over a connection of its own, so that it works while the picture is stale. Within a second a person
knows: the arm stands, or was not reached, or is not confirmed at standstill yet.
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

WITHIN_S: Final = 0.8  # of the second that a person waits: the network takes the rest
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
    """Send it through the view socket, and watch until the arm stands."""
    request = bare(command, on_behalf_of)
    last: Reply | None = None  # the first is the command's own, and shows that it was reached
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
    """True if nothing is left to wait for. A disarmed arm may go on with its trajectory."""
    if command == "disarm" and not reply.unproved and reply.mode != Mode.STOPPING:
        return True
    return _stands(reply)


def _stands(reply: Reply) -> bool:
    return reply.mode in STANDS and not reply.unproved


def _as_reply(reply: Reply) -> Reply:
    """Mode and doubts of a Status, in the form of a stop's own reply."""
    status = reply.status
    if status is None:
        return reply
    return Reply(ok=True, mode=status.mode, armed=status.armed, unproved=status.unproved)
