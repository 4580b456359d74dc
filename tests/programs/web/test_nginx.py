"""The page on a LAN: nginx as the example configures it, TLS, contactd-web at a unix socket."""

import contextlib
import http.client
import shutil
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from contactd_client.paths import view_socket_path

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "systemd/examples/web-nginx.conf"
NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
NAME = "arm.example"
TOKEN = "0123456789abcdef"
TIMEOUT_S = 30.0

pytestmark = pytest.mark.skipif(
    NGINX is None or shutil.which("openssl") is None,
    reason="NOT TRIED: no nginx and openssl here (apt install nginx-light openssl)",
)


def configuration(folder: Path, port: int, page: Path) -> Path:
    """The example, with this test's port, certificate and socket."""
    text = EXAMPLE.read_text()
    for there, here in {
        "listen 443 ssl": f"listen 127.0.0.1:{port} ssl",
        "/etc/ssl/contactd/arm.pem": str(folder / "arm.pem"),
        "/etc/ssl/contactd/arm.key": str(folder / "arm.key"),
        "http://unix:/run/contactd-web/page.sock:": f"http://unix:{page}:",
    }.items():
        assert text.count(there) == 1
        text = text.replace(there, here)
    user = "user root;" if (folder.stat().st_uid == 0) else ""
    temporary = "".join(
        f"{kind}_temp_path {folder}/{kind};"
        for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    whole = folder / "nginx.conf"
    whole.write_text(
        f"{user} daemon off; pid {folder}/pid; error_log {folder}/error.log; events {{}} "
        f"http {{ access_log off; {temporary}\n{text}\n}}\n"
    )
    return whole


@pytest.fixture
def port(fake_daemon: Any, tmp_path: Path) -> Iterator[int]:
    """Port of nginx before contactd-web before a daemon."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free = int(probe.getsockname()[1])
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"]
    command += ["-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}"]
    command += ["-keyout", str(tmp_path / "arm.key"), "-out", str(tmp_path / "arm.pem")]
    subprocess.run(command, check=True, capture_output=True)
    token, page = tmp_path / "token", tmp_path / "page.sock"
    token.write_text(TOKEN)
    token.chmod(0o640)
    serve = [sys.executable, "-m", "programs.web.contactd_web", "--bind", f"unix:{page}"]
    serve += ["--tls", "--host", NAME, "--token-file", str(token), "--no-recordings"]
    serve += [str(view_socket_path(fake_daemon.path))]
    assert NGINX is not None
    proxy = [NGINX, "-p", str(tmp_path), "-e", str(tmp_path / "error.log")]
    with (
        subprocess.Popen(serve, stdout=subprocess.PIPE) as server,
        subprocess.Popen([*proxy, "-c", str(configuration(tmp_path, free, page))]) as nginx,
    ):
        try:
            assert server.stdout is not None
            assert b"for a proxy" in server.stdout.readline()
            wait_for(free, nginx, tmp_path / "error.log")
            yield free
        finally:
            nginx.terminate()
            server.terminate()


def wait_for(port: int, nginx: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
        except OSError:
            assert nginx.poll() is None, log.read_text()
            assert time.monotonic() < deadline
            time.sleep(0.05)
        else:
            return


def test_the_example_admits_only_authorised_requests(port: int, fake_daemon: Any) -> None:
    fake_daemon.modes = {"stop": ["holding"]}
    tls = ssl.create_default_context()
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE  # it is the test's own
    own = {"Host": NAME, "Origin": f"https://{NAME}"}

    def ask(method: str, path: str, headers: dict[str, str], body: str = "") -> tuple[int, str]:
        """Status, and the cookie that is set."""
        connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=TIMEOUT_S, context=tls)
        with contextlib.closing(connection):
            connection.request(method, path, body or None, headers)
            answer = connection.getresponse()
            assert answer.status == 101 or answer.headers["Connection"] == "close"
            return answer.status, answer.headers.get("Set-Cookie", "")

    assert ask("GET", "/", {"Host": "evil.example"})[0] == 421
    assert ask("GET", "/page.js", own)[0] == 401
    form = {**own, "Content-Type": "application/x-www-form-urlencoded"}
    status, cookie = ask("POST", "/enter", form, f"token={TOKEN}")
    assert (status, "Secure" in cookie, "HttpOnly" in cookie) == (303, True, True)
    kept = {**own, "Cookie": cookie.split(";")[0]}
    assert ask("GET", "/page.js", kept)[0] == 200
    command = {**kept, "X-Contactd-Command": "stop"}
    assert ask("POST", "/arms/0/stop", {**command, "Origin": "https://evil.example"})[0] == 403
    assert ask("POST", "/arms/0/stop", command)[0] == 200
    assert "stop" in [name for name, _ in fake_daemon.seen]
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    key = {"Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg=="}
    assert ask("GET", "/live/0", {**kept, **upgrade, **key})[0] == 101
    assert ask("GET", "/live/0", {**own, **upgrade, **key})[0] == 401
