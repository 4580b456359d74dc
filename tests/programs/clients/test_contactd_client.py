"""Client for other programs, against a daemon's socket, and against those that are none."""

import ast
import asyncio
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import pytest

import contactd_client
from common.errors import ContactdError
from contactd_client import Client, ControlError, Joined, Lost, UnreachableError, watch
from contactd_client.aio import AsyncClient, AsyncConnection
from contactd_client.aio import watch as watch_async
from contactd_client.paths import view_socket_path
from daemon.protocol.replies import Reply
from programs.clients.client import Client as OwnClient
from tests.fake_daemon import snapshot_at, state_at

SOURCES = Path(contactd_client.__file__).parent


def plain(message: msgspec.Struct) -> Any:
    return json.loads(msgspec.json.encode(message))


@pytest.fixture
def view(fake_daemon: Any) -> Path:
    return view_socket_path(fake_daemon.path)


@contextmanager
def answering(listener: socket.socket, packet: bytes, clients: int = 1) -> Iterator[Path]:
    """Path of a socket that answers a request of each client by a packet, and closes."""

    def serve() -> None:
        for _ in range(clients):
            accepted, _ = listener.accept()
            with accepted:
                accepted.recv(4096)
                accepted.send(packet)

    thread = threading.Thread(target=serve)
    thread.start()
    yield Path(listener.getsockname())
    thread.join()


# --- its parts ------------------------------------------------------------------------------


def test_it_imports_nothing_but_the_standard_library() -> None:
    names = set()
    for source in SOURCES.glob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                names.add(str(node.module))
    tops = {name.partition(".")[0] for name in names}
    assert tops - {"contactd_client"} <= set(sys.stdlib_module_names)


def test_it_imports_no_slow_modules() -> None:
    """Apart from contactd, as in an environment of its own."""
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import contactd_client; "
        "print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    )
    words = [sys.executable, "-I", "-S", "-c", program, str(SOURCES.parent)]
    loaded = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert "contactd_client" in loaded
    assert not {"asyncio", "msgspec", "numpy", "daemon", "ssl", "subprocess"} & set(loaded)


def test_its_errors_are_those_of_contactd() -> None:
    assert issubclass(UnreachableError, ContactdError)
    assert UnreachableError.exit_code == 69


# --- one connection ------------------------------------------------------------------------


def test_the_view_socket_is_where_it_looks_first(
    fake_daemon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CONTACTD_SOCKET", str(fake_daemon.path))
    with Client() as client:
        assert client.status()["pid"] == 4711
        reply = client.ask({"command": "arm"})
    assert not reply["ok"]
    assert "the view socket takes only" in reply.get("message", "")


def test_states_are_those_that_were_sent(fake_daemon: Any, view: Path) -> None:
    with Client(view) as client:
        snapshot, states = client.states()
        taken = list(islice(states, 20))
    assert taken[0]["tick"] == snapshot["tick"] + 1
    for state in taken:
        assert state == plain(state_at(state["tick"]))


def test_asyncio_gets_the_same(fake_daemon: Any, view: Path) -> None:
    async def run() -> tuple[Any, list[Any], Any]:
        async with await AsyncClient.open(view) as client:
            status = await client.status()
            snapshot, states = await client.states()
            taken = [await anext(states) for _ in range(20)]
            assert taken[0]["tick"] == snapshot["tick"] + 1
            return status, taken, await AsyncClient.open(view)

    status, taken, other = asyncio.run(run())
    other.close()
    assert status["pid"] == 4711
    for state in taken:
        assert state == plain(state_at(state["tick"]))


def test_a_refusal_gives_every_reason(fake_daemon: Any, view: Path) -> None:
    fake_daemon.refusals |= {"status": ["too early", "too late"], "subscribe": ["never"]}
    with Client(view) as client:
        with pytest.raises(ControlError, match=r"^status is refused; too early; too late$"):
            client.status()
        with pytest.raises(ControlError, match=r"^subscribe is refused; never$"):
            client.states()


ANSWERS = [
    (b"hello", "speaks another version"),
    (b"[]", "speaks another version: no `ok`"),
    (b"\xff\xfe", "speaks another version"),
    (b"[" * 100_000, "speaks another version"),
    (b'{"ok": true, "snapshot": 3}', "speaks another version: its `snapshot` is 3"),
    (b'{"ok": true, "snapshot": [{}]}', "speaks another version: its `snapshot` is"),
    (b'{"ok": false, "reasons": true}', "speaks another version: its `reasons` is True"),
    (b'{"ok": false, "reasons": null}', "speaks another version: its `reasons` is None"),
    (b'{"ok": false, "reasons": [3]}', "speaks another version: its `reasons` is"),
    (b'{"ok": false, "message": 3}', "speaks another version: its `message` is 3"),
    (b'{"ok": "yes"}', "speaks another version: its `ok` is 'yes'"),
    (b'{"ok":true}', "^refused$"),
    (b'{"ok":true,"snapshot":{"format":99}}', "are of format 99, this client reads 7"),
    (b'{"ok":true,"snapshot":{}}', "are of format 0, this client reads 7"),
]


def states(path: Path) -> None:
    with Client(path) as client:
        client.states()


def states_of_asyncio(path: Path) -> None:
    async def run() -> None:
        async with await AsyncClient.open(path) as client:
            await client.states()

    asyncio.run(run())


@pytest.mark.parametrize("ask", [states, states_of_asyncio])
@pytest.mark.parametrize(("packet", "words"), ANSWERS)
def test_a_wrong_answer_is_reported(
    listener: socket.socket, packet: bytes, words: str, ask: Callable[[Path], None]
) -> None:
    with answering(listener, packet) as path, pytest.raises(ControlError, match=words):
        ask(path)


async def test_a_late_answer_is_never_taken_for_the_next(listener: socket.socket) -> None:
    async with await AsyncClient.open(Path(listener.getsockname()), 0.05) as client:
        with pytest.raises(UnreachableError, match="does not answer"):
            await client.ask({"command": "arm"})
        with pytest.raises(UnreachableError, match="connect again"):
            await client.ask({"command": "disarm"})
    with Client(Path(listener.getsockname()), 0.05) as client:
        with pytest.raises(UnreachableError, match="does not answer"):
            client.ask({"command": "arm"})
        with pytest.raises(UnreachableError, match="connect again"):
            client.ask({"command": "disarm"})


def test_an_answer_of_a_daemon_that_has_ended_is_read(listener: socket.socket) -> None:
    async def run() -> str:
        async with await AsyncClient.open(Path(listener.getsockname())) as client:
            accepted, _ = listener.accept()
            with accepted:
                accepted.send(b'{"ok":false,"message":"full"}')
            return (await client.ask({"command": "stop"})).get("message", "")

    assert asyncio.run(run()) == "full"


def test_slow_commands_are_waited_for(listener: socket.socket) -> None:
    """The drives may have to boot before these."""
    with Client(Path(listener.getsockname()), 0.01) as client:
        accepted, _ = listener.accept()
        with accepted:
            threading.Timer(0.1, accepted.send, [b'{"ok":true}']).start()
            assert client.ask({"command": "reset"})["ok"]


def test_a_request_that_is_no_json_is_not_sent(fake_daemon: Any, view: Path) -> None:
    with Client(view) as client:
        for lease in (float("nan"), object()):
            with pytest.raises(ControlError, match="no request"):
                client.ask({"command": "arm", "lease_s": lease})  # type: ignore[typeddict-item]
        assert client.ask({"command": "status"})["ok"]


# --- watching ------------------------------------------------------------------------------


def kinds(news: list[Any]) -> list[str]:
    """Messages in order, States in a row as one."""
    names = [type(one).__name__ for one in news]
    return [name for i, name in enumerate(names) if i == 0 or name != names[i - 1]]


def test_it_joins_again(fake_daemon: Any, view: Path) -> None:
    """The daemon closes its sockets, and opens them again at the same place."""
    stream = watch(view, retry_s=0.01)
    news = list(islice(stream, 5))
    fake_daemon.stopped.set()
    while not (isinstance(news[-1], Lost) and "no contactd serves" in news[-1].why):
        news.append(next(stream))
    fake_daemon.stopped.clear()
    thread = threading.Thread(target=fake_daemon.run)
    thread.start()
    while kinds(news)[-2:] != ["Joined", "dict"]:
        news.append(next(stream))
    stream.close()
    fake_daemon.stopped.set()
    thread.join()
    first, again = [one for one in news if isinstance(one, Joined)]
    assert kinds(news)[:3] == ["Joined", "dict", "Lost"]
    assert again.snapshot["tick"] > first.snapshot["tick"]
    reasons = [one.why for one in news if isinstance(one, Lost)]
    assert reasons == list(dict.fromkeys(reasons))  # none is reported twice


def test_each_loss_is_reported(listener: socket.socket) -> None:
    """Client of a daemon that begins well and hangs up, every time."""
    reply = msgspec.json.encode(Reply(ok=True, snapshot=snapshot_at(0)))
    with answering(listener, reply, clients=3) as path:
        news = list(islice(watch(path, retry_s=0.001), 6))
    assert [type(one).__name__ for one in news] == ["Joined", "Lost"] * 3
    assert {one.why for one in news[1::2]} == {"the daemon closed the connection"}


def test_it_waits_for_a_daemon_that_is_not_there_yet(tmp_path: Path) -> None:
    async def first() -> object:
        async for news in watch_async(tmp_path / "nothing"):
            return news
        return None

    said = f"no contactd serves {tmp_path / 'nothing'}: is it running? (`contactd run CONFIG`)"
    expected = Lost(said)
    assert next(watch(tmp_path / "nothing")) == expected
    assert asyncio.run(first()) == expected


def test_contactds_own_client_uses_its_connection(fake_daemon: Any) -> None:
    with OwnClient(fake_daemon.path) as client:
        assert client.ask_status().pid == 4711
    assert OwnClient.__init__.__globals__["Connection"] is contactd_client.client.Connection


def test_asyncio_reads_packets_sent_before_the_end_of_the_connection() -> None:
    ours, its_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, its_end:
        ours.setblocking(False)
        its_end.send(b"why")
        its_end.shutdown(socket.SHUT_WR)
        connection = AsyncConnection(ours)
        assert connection.waiting() == [b"why"]
        with pytest.raises(ControlError, match="closed the connection"):
            connection.waiting()
