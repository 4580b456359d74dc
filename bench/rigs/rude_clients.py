"""Rude clients of the control socket: they flood, babble, cut messages off, never read, upload
without end, or connect a thousand times. An attack is a generator, and each `next` one round."""

import contextlib
import errno
import multiprocessing
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ATTACKERS = 2
# Between two rounds of an attacker: it must not need a whole core of a machine that has two.
PAUSE_S = 0.002

Attack = Callable[[str], Iterator[None]]


def _dial(path: str) -> socket.socket:
    one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    with contextlib.suppress(OSError):
        one.connect(path)
    return one


def _sending(path: str, packets: list[bytes], connections: int, *, listens: bool) -> Iterator[None]:
    """Send everything on every connection as fast as it is taken; dropped ones come again."""
    opened = [_dial(path) for _ in range(connections)]
    while True:
        for i, one in enumerate(opened):
            try:
                for packet in packets:
                    one.send(packet)
                while listens and one.recv(1 << 20):
                    pass
            except BlockingIOError:
                continue
            except OSError as error:
                if error.errno != errno.EMSGSIZE:  # which is too long for the kernel
                    one.close()
                    opened[i] = _dial(path)
        yield


def flood(path: str) -> Iterator[None]:
    """Requests for the longest answers, which are read."""
    return _sending(path, [b'{"command":"status"}'] * 4, 12, listens=True)


def babble(path: str) -> Iterator[None]:
    """Garbage, messages that are cut off, and 10 MB."""
    packets = [b"[" * 8000, b'{"command":"sta', bytes(range(256)) * 8, b"x" * 150_000]
    return _sending(path, [*packets, b"x" * 10_000_000], 12, listens=True)


def deaf(path: str) -> Iterator[None]:
    """Readers that never read, and those who ask and do not listen."""
    return _sending(path, [b'{"command":"subscribe"}', b'{"command":"status"}'], 12, listens=False)


def upload(path: str) -> Iterator[None]:
    """Trajectories without end: the request that costs most."""
    row = "[%.3f,0.0123456789,-0.0123456789]"
    header = b'{"command":"load","header":{"name":"x","joints":["joint"]}}'
    rows = ",".join(row % (0.01 * i) for i in range(200))
    body = b'{"command":"load","rows":[%s]}' % rows.encode()
    return _sending(path, [header, body], 12, listens=True)


def crowd(path: str) -> Iterator[None]:
    """A thousand connections that stay as long as they are let."""
    held: list[socket.socket] = []
    while True:
        held += [_dial(path) for _ in range(20)]
        while len(held) > 1000:
            held.pop(0).close()
        yield


def siege(path: str) -> Iterator[None]:
    """Flood and crowd at once: of two such attackers, 32 connections flood and 200 want in."""
    flooding = _sending(path, [b'{"command":"status"}'] * 4, 32 // ATTACKERS, listens=True)
    wanting = [_dial(path) for _ in range(200 // ATTACKERS)]
    while True:
        next(flooding)
        for i, one in enumerate(wanting):
            if _is_out(one):
                one.close()
                wanting[i] = _dial(path)
        yield


def stampede(path: str) -> Iterator[None]:
    """Connections without end, each given up at once."""
    while True:
        for one in [_dial(path) for _ in range(30)]:
            one.close()
        yield


def garrison(path: str) -> Iterator[None]:
    """As many connections as there are places, kept; who is put out comes again, and asks."""
    held = [_dial(path) for _ in range(300)]
    while True:
        for i, one in enumerate(held):
            if _is_out(one):
                one.close()
                held[i] = _dial(path)
            with contextlib.suppress(OSError):
                held[i].send(b'{"command":"status"}')
        yield


def _is_out(one: socket.socket) -> bool:
    """True if a connection never came about, or was closed by the daemon."""
    try:
        return not one.recv(1 << 16)
    except BlockingIOError:
        return False
    except OSError:
        return True


ATTACKS: dict[str, Attack] = {
    attack.__name__: attack
    for attack in (flood, babble, deaf, upload, crowd, siege, stampede, garrison)
}


def _attack(name: str, path: str) -> None:
    for _ in ATTACKS[name](path):
        time.sleep(PAUSE_S)


@contextlib.contextmanager
def attacking(name: str, path: Path) -> Iterator[None]:
    """Processes that attack while the block lasts."""
    context = multiprocessing.get_context("fork")
    # Who holds a thousand connections is one, the others are many.
    count = 1 if name == "crowd" else ATTACKERS
    made = [
        context.Process(target=_attack, args=(name, str(path)), daemon=True) for _ in range(count)
    ]
    for process in made:
        process.start()
    try:
        yield
    finally:
        for process in made:
            process.kill()
            process.join()
