"""Commands of `contactctl`: sends them, waits for their effect, prints the replies."""
# ruff: noqa: PLC0415 - messages are imported by the command that needs them

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import click

from common.errors import ControlError
from daemon.modes.table import Mode
from daemon.protocol.lease import SENSES_S
from programs.command_line.options import Options
from programs.command_line.sentences import say

if TYPE_CHECKING:
    from daemon.protocol.replies import Reply, Status
    from daemon.protocol.requests import Command
    from programs.clients.client import Client

WAIT_S = 5.0
SENSING_WAIT_S = 1.0
RESET_S = 0.6  # a drive still in fault half a second after a reset is a new fault
POLL_S = 0.02

# Modes that a command leads to after some time, waited for unless `--no-wait`.
GOALS: dict[str, frozenset[str]] = {
    "enable": frozenset({Mode.HOLDING}),
    "pause": frozenset({Mode.HOLDING}),
    "stop": frozenset({Mode.HOLDING, Mode.OFF, Mode.FAULTED}),
    "disable": frozenset({Mode.OFF}),
    "disarm": frozenset(Mode) - {Mode.STOPPING},  # a guided arm that is disarmed first stops
}
RESTING = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})  # left only by a command or contact
TO_REST = frozenset({"pause", "disarm", "stop", "disable"})  # commands that bring the arm to rest
NOT_REACHED = "NOT REACHED: use the emergency stop."
UNSEEN = "the arm is not seen to stand: use the emergency stop if it moves."
NOT_REACHED_ON_ITS_WAY = "NOT REACHED: use the emergency stop if the arm moves."
IF_IT_MOVES = "press the emergency stop if it moves"
YIELDING = frozenset({Mode.ADMITTANCE, Mode.RETRACTING})  # until the person lets go of the arm


def carry_out(options: Options, command: "Command", wait: bool = False) -> None:
    """Send `command`, with `wait` until it has taken effect, and print the outcome, or the daemon's
    reply if there is nothing to wait for. Exits with 1 on failure, also if a joint commanded to
    stop is not confirmed at standstill."""
    to_rest = command in TO_REST
    with ExitStack() as stack:
        with lost_as(NOT_REACHED if to_rest else ""):
            client = stack.enter_context(options.connect())
            if command == "reset":
                from programs.clients.waiting import reset

                reply = _without_a_new_fault(client, reset(client, WAIT_S))
            else:
                reply = client.request(command)
        with lost_as(f"{command} is given, but {UNSEEN}" if to_rest else ""):
            if reply.ok and wait and (reply.unproved or reply.mode not in GOALS[command]):
                reply = wait_for(client, reply, GOALS[command], yields=command == "pause")
            elif reply.ok and reply.unproved:
                reply = _not_seen_to_stand(reply, reply.unproved, client.ask_status().silenced)
    answer(options, reply)


def wait_until_sensing(options: Options) -> None:
    """Wait until every joint of a holding arm has sensed contact for as long as `arm` requires, at
    most SENSING_WAIT_S; `arm` will name a joint that does not."""
    from programs.clients.sensing import sensing_for_s
    from programs.clients.waiting import asked_until

    def settled(now: "Status") -> bool:
        known = now.sensing is not None and now.mode == Mode.HOLDING
        return not known or (sensing_for_s(now) or 0.0) > SENSES_S

    with options.connect() as client:
        asked_until(client.ask_status, settled, SENSING_WAIT_S)


@contextmanager
def lost_as(words: str) -> Iterator[None]:
    """Context that prefixes connection errors with `words` for a person at the arm and keeps their
    exit status."""
    try:
        yield
    except ControlError as error:
        if not words:
            raise
        raise type(error)(f"{words} ({error})") from error


def take_up_changes(options: Options) -> None:
    """Make a daemon in mode off reload files that were changed since it read them. Raises
    ControlError if they are rejected."""
    with options.connect() as client:
        now = client.ask_status()
    if now.mode != Mode.OFF or not now.changed:
        return
    from programs.clients.reload import reload

    if not options.json:
        click.echo(f"taking up {', '.join(now.changed)}")
    reload(options.socket)


def _without_a_new_fault(client: "Client", reply: "Reply") -> "Reply":
    """Reply to `reset`, turned into a failure if a new fault follows within RESET_S."""
    from msgspec.structs import replace

    from programs.clients.waiting import asked_until

    if not reply.ok:
        return reply
    now = asked_until(client.ask_status, lambda status: status.mode == Mode.FAULTED, RESET_S)
    if now.mode != Mode.FAULTED:
        return reply
    return replace(reply, ok=False, message=f"reset, and a new fault: {now.cause}", mode=now.mode)


def _not_seen_to_stand(reply: "Reply", unproved: list[str], silenced: bool) -> "Reply":
    """Reply turned into a failure: these joints are not confirmed at standstill."""
    from msgspec.structs import replace

    reasons = [reply.message, *reply.reasons]
    if silenced:
        reasons.append("contactd sends nothing to the drives until `reset`")
    text = f"not seen to stand: {', '.join(unproved)}; {IF_IT_MOVES}"
    return replace(reply, ok=False, message=text, reasons=reasons, unproved=unproved)


def answer(options: Options, reply: "Reply") -> None:
    """Print a reply on stdout, or a refusal on stderr and exit with 1."""
    if options.json:
        print_json(reply)
    else:
        for check in reply.checks:
            say(str(check), err=not reply.ok)
        if reply.sensitivity is not None:
            from programs.clients.sensitivity import sensitivity_lines

            say("\n".join(sensitivity_lines(reply.sensitivity)))
        said = _named(reply.message) or (str(reply.mode) if reply.ok else "refused")
        say(said if reply.ok else f"contactctl: {said}", err=not reply.ok)
        for warning in reply.warnings:
            say(f"  warning: {warning}", err=True)
        # The failed checks are the reasons, already printed.
        for reason in reply.reasons if not reply.checks else ():
            say(f"  - {reason}", err=True)
    if not reply.ok:
        sys.exit(1)


def _named(message: str) -> str:
    """Message with the command that was typed instead of a request that it sent: `home` sends `go`,
    `playback` also `start`."""
    request, _, text = message.partition(": ")
    typed = click.get_current_context().info_name
    return f"{typed}: {text}" if request in ("go", "start") and text else message


def wait_for(
    client: "Client", first: "Reply", goal: frozenset[str], *, yields: bool = False
) -> "Reply":
    """Poll until the mode is in `goal` and every joint commanded to stop is confirmed at
    standstill, until the mode comes to rest elsewhere, or until WAIT_S have passed. With `yields`,
    a person who guides the arm ends the wait successfully."""
    from daemon.protocol.replies import Reply

    deadline = time.monotonic() + WAIT_S
    left = False
    while True:
        now = client.ask_status()
        left = left or now.mode != first.mode
        late = time.monotonic() > deadline
        guided = yields and now.mode in YIELDING
        elsewhere = left and now.mode in RESTING and now.mode not in goal
        if (now.mode in goal and not now.unproved) or guided or late or elsewhere:
            break
        time.sleep(POLL_S)
    text = f"{now.mode}{', armed' if now.armed else ''}: {now.cause}"
    if guided:
        paused = now.trajectory.state == "paused"
        what = "the trajectory is paused" if paused else "no trajectory will continue"
        text = f"{now.mode}: {what}; the arm holds once it is released"
    elif now.mode not in goal:
        expected = "holding" if "holding" in goal else Mode.OFF
        text = f"not {expected} {f'after {WAIT_S:.0f} s' if late else 'but'} {text}"
    reply = Reply(ok=guided or now.mode in goal, message=text, mode=now.mode, armed=now.armed)
    if not now.unproved:
        return reply
    return _not_seen_to_stand(reply, now.unproved, now.silenced)


def print_json(message: Any) -> None:
    """One line of JSON on stdout."""
    import msgspec

    click.echo(msgspec.json.encode(message).decode())
