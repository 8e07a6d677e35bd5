"""Serves one page on a port of this machine."""

from __future__ import annotations

import ipaddress
import socket
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from dmfc.errors import DmfcError

HOST = "127.0.0.1"


def page_server(page: bytes, host: str = HOST, port: int = 0) -> ThreadingHTTPServer:
    """A server that answers `/` with these bytes of HTML and nothing else; 0: any free port.

    It answers to addresses, `host` and names of this machine alone: a page of someone else's whose
    name leads here (DNS rebinding) could read it otherwise.
    The caller runs and closes it. Raises DmfcError where it cannot listen there.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if not _ours(self.headers.get("Host", ""), host):
                self.send_error(HTTPStatus.FORBIDDEN, "Host is no name of this machine")
                return
            if self.path.split("?")[0] != "/":
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, *_: object) -> None:
            """Requests are of no interest to who looks at the page."""

    try:
        return ThreadingHTTPServer((host, port), Handler)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DmfcError(
            f"cannot listen on {host}, port {port}: {reason} (--host, --port)"
        ) from error


def _ours(header: str, host: str) -> bool:
    """Whether the header Host names this machine. An address cannot be made to lead elsewhere."""
    name = header.rpartition(":")[0] if header.rpartition(":")[2].isdigit() else header
    name = name.strip("[]").lower().rstrip(".")
    try:
        ipaddress.ip_address(name)
        return True
    except ValueError:
        return name in {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn()}


def address(server: ThreadingHTTPServer) -> str:
    """Where a browser finds it."""
    host, port = server.server_address[:2]
    return f"http://{host!s}:{port}/"
