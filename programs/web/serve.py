"""Start and end of the page's server: its settings from the command line, and its socket."""

import asyncio
import contextlib
import os
import re
import signal
import socket
import stat
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from aiohttp import web

from common.errors import ConfigurationError, UnreachableError
from programs.web.connections import bounded
from programs.web.elsewhere_routes import Others
from programs.web.guard import LEAST_TOKEN, OriginRules, Places, hosts_of
from programs.web.server import Settings, Site

UNIX: Final = "unix:"
LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
ANYWHERE: Final = ("0.0.0.0", "::", "*", "")
MOST_CONNECTIONS: Final = 256
MOST_CONNECTIONS_OF_ONE: Final = 32
NICE: Final = 10
THREADS: Final = 4
END_S: Final = 2.0
_HOST: Final = re.compile(r"([\w.-]+|\[[\da-fA-F:.]+\])(:\d{1,5})?")


def settings_of(
    view_sockets: Sequence[Path],
    *,
    bind: str,
    port: int,
    hosts: Sequence[str],
    tls: bool,
    read_only: bool,
    token_file: Path | None,
    recordings: Path | None,
) -> Settings:
    """Settings from the command line. Raises ConfigurationError for invalid combinations."""
    proxied = bind.startswith(UNIX)
    if twice := [path for path in view_sockets if view_sockets.count(path) > 1]:
        raise ConfigurationError(f"{twice[0]}: given twice; each arm has one tab")
    for name in hosts:
        if not _HOST.fullmatch(name):
            raise ConfigurationError(
                f"--host {name}: must be a name or an address, [in brackets] if it has colons, "
                "optionally followed by :PORT"
            )
    if proxied and not hosts:
        raise ConfigurationError("--bind unix:PATH: --host is required: the proxy's public name")
    if tls and not proxied:
        raise ConfigurationError("--tls: requires --bind unix:PATH, where the proxy connects")
    if not proxied and bind not in LOOPBACK and not hosts and bind in ANYWHERE:
        raise ConfigurationError(
            f"--bind {bind}: --host is required: the name or address in the browsers' URL"
        )
    token = _read_token(token_file) if token_file else ""
    if not token and not read_only and (proxied or bind not in LOOPBACK):
        raise ConfigurationError(
            f"--bind {bind}: others could stop the arm; use --token-file or --read-only"
        )
    own = [] if proxied or bind in ANYWHERE else [bind]
    names = {*LOOPBACK, *own} if not proxied else set()
    given = frozenset(name.lower() for name in hosts)
    return Settings(
        view_sockets=tuple(view_sockets),
        origin_rules=OriginRules(
            hosts_of(sorted(names), port)
            | hosts_of([name for name in given if not _has_port(name)], None if proxied else port)
            | {name for name in given if _has_port(name)},
            tls,
        ),
        token=token,
        read_only=read_only,
        recordings=recordings,
        proxied=proxied,
    )


def _has_port(name: str) -> bool:
    return name.rpartition(":")[2].isdigit() and (name.count(":") == 1 or "]:" in name)


def _read_token(path: Path) -> str:
    """Token in a file. Raises ConfigurationError if the file cannot be read, or others may read it,
    or for an invalid token."""
    try:
        text = path.read_text().strip()
        mode = path.stat().st_mode
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: cannot be read: it is not text") from error
    if mode & (stat.S_IROTH | stat.S_IWOTH):
        raise ConfigurationError(f"{path}: is readable for all users; chmod 640 {path}")
    if len(text) < LEAST_TOKEN or not text.isascii() or any(c.isspace() for c in text):
        raise ConfigurationError(
            f"{path}: a token must have at least {LEAST_TOKEN} ASCII characters and no spaces "
            f"(openssl rand -hex 16)"
        )
    return text


def serve(
    settings: Settings,
    listener: socket.socket,
    say: Callable[[str], object],
    others: Others | None = None,
) -> None:
    """Serve until SIGTERM or SIGINT."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)  # lower priority than the daemon's loop
    asyncio.run(_serve(settings, listener, say, others))


def listen(bind: str, port: int) -> socket.socket:
    """Listening socket; port 0 takes a free one. Raises UnreachableError if it cannot listen."""
    try:
        if not bind.startswith(UNIX):
            family = socket.AF_INET6 if ":" in bind else socket.AF_INET
            return socket.create_server((bind, port), family=family, backlog=64)
        path = Path(bind.removeprefix(UNIX))
        with contextlib.suppress(FileNotFoundError):
            if stat.S_ISSOCK(path.lstat().st_mode):
                path.unlink()
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(path))
        path.chmod(0o660)
        listener.listen(64)
    except OSError as error:
        where = bind if bind.startswith(UNIX) else f"{bind} port {port} (--bind, --port)"
        number = error.errno or 0  # negative for errors of name resolution
        why = os.strerror(number) if number > 0 else "no such address" if number else str(error)
        raise UnreachableError(f"cannot listen on {where}: {why}") from error
    return listener


@contextlib.asynccontextmanager
async def serving(
    settings: Settings, listener: socket.socket, others: Others | None = None
) -> AsyncIterator[Site]:
    """Context in which the page's server runs at `listener`."""
    site = Site(settings, others)
    runner = web.AppRunner(
        site.application(),
        access_log=None,
        handle_signals=False,
        shutdown_timeout=END_S,
        auto_decompress=False,  # browsers do not compress requests; it guards against zip bombs
    )
    await runner.setup()
    assert runner.server is not None
    of_one = MOST_CONNECTIONS if settings.proxied else MOST_CONNECTIONS_OF_ONE
    factory = bounded(runner.server, Places(MOST_CONNECTIONS, of_one))
    loop = asyncio.get_running_loop()
    create = loop.create_unix_server if settings.proxied else loop.create_server
    server = await create(factory, sock=listener)
    try:
        yield site
    finally:
        server.close()
        site.abort()
        await runner.cleanup()


async def _serve(
    settings: Settings, listener: socket.socket, say: Callable[[str], object], others: Others | None
) -> None:
    ended = asyncio.Event()
    # Few threads on any computer, as TasksMax= of the unit limits them: one records, others open
    # files.
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(THREADS))
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    async with serving(settings, listener, others) as site:
        say(_where(settings, listener))
        jobs = [asyncio.create_task(ended.wait()), *site.jobs]
        done, _ = await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
        for job in done:
            job.result()  # a program error ends the process, and the service restarts it


def _where(settings: Settings, listener: socket.socket) -> str:
    name = listener.getsockname()
    if settings.proxied:
        return f"contactd-web: the page, for a proxy, at {name}"
    host, port = name[:2]
    shown = f"[{host}]" if ":" in host else host
    return f"contactd-web: the page is at http://{shown}:{port}/"
