"""The page: its arrays come back, no name breaks out, and a server gives exactly its bytes."""

from __future__ import annotations

import base64
import http.client
import json
import re
import socket
import threading
import urllib.error
import urllib.request
from html.parser import HTMLParser

import numpy as np
import pytest

from dmfc.errors import DmfcError
from dmfc.view.page import make_page, packed, script_json
from dmfc.view.serve import address, page_server
from tests.view.conftest import HOSTILE


class Parsed(HTMLParser):
    """The scripts of a page, its title, and what its tags would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.title = ""
        self.loads: list[str] = []
        self.inside = ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.inside = tag
        if tag == "script":
            self.scripts.append("")
        self.loads += [value for name, value in attributes if name in ("src", "href")]

    def handle_endtag(self, tag):
        self.inside = ""

    def handle_data(self, text):
        if self.inside == "script":
            self.scripts[-1] += text
        elif self.inside == "title":
            self.title += text


def array(value) -> np.ndarray:
    found = np.frombuffer(base64.b64decode(value["base64"]), dtype=f"<{value['kind']}")
    return found.reshape(value["shape"])


def test_the_arrays_come_back_and_no_name_breaks_out(view):
    page = Parsed(make_page(view))
    assert len(page.scripts) == 2
    data = json.loads(page.scripts[0])
    assert data["title"] == page.title == HOSTILE
    np.testing.assert_allclose(array(data["points"]), view.points, atol=1e-7)
    np.testing.assert_allclose(array(data["glyphs"]), view.grasps.glyphs, atol=1e-7)
    poses = array(data["T_world_link"])
    np.testing.assert_allclose(poses, view.grasps.T_world_link[:, :, :3], atol=1e-6)
    for told, mesh in zip(data["hand"], view.hand, strict=True):
        assert told["name"] == mesh.name
        np.testing.assert_array_equal(array(told["faces"]), mesh.faces)


def test_the_page_loads_nothing(view):
    text = make_page(view)
    assert Parsed(text).loads == ["data:,"]
    assert "default-src 'none'" in text
    assert not re.search(r"https?://", text)


@pytest.mark.parametrize("text", [HOSTILE, "\u2028 & ' \" \\", "<!-- data -->"])
def test_json_in_a_script(text):
    written = script_json({"name": text})
    assert not set("<>&\u2028") & set(written)
    assert json.loads(written) == {"name": text}


def test_numbers_are_packed_row_by_row():
    told = packed(np.array([[1, 2], [3, 4]]).T, "f4")
    assert told["shape"] == [2, 2]
    np.testing.assert_array_equal(array(told), [[1, 3], [2, 4]])


def test_the_server_gives_these_bytes_to_this_machine_alone():
    page = "<!doctype html>ä".encode()
    with page_server(page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        assert server.server_address[0] == "127.0.0.1"
        with urllib.request.urlopen(address(server)) as answer:
            assert answer.read() == page
            assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(address(server) + "etc/passwd")
        # 127.0.0.2 is this machine too, but not the address that it listens on.
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", server.server_port), 2)
        with pytest.raises(DmfcError, match=f"port {server.server_port}: Address already in use"):
            page_server(page, port=server.server_port)
        server.shutdown()


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:{port}", 200),
        ("localhost:{port}", 200),
        ("[::1]:{port}", 200),
        ("192.168.1.7", 200),
        (socket.gethostname(), 200),
        ("evil.example:{port}", 403),
        ("127.0.0.1.evil.example", 403),
        ("localhost.evil.example:{port}", 403),
        ("", 403),
    ],
)
def test_another_name_that_leads_here_gets_nothing(host, status):
    """DNS rebinding: the page of evil.example asks 127.0.0.1 in its own name."""
    with page_server(b"secret") as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port)
        connection.request("GET", "/", headers={"Host": host.format(port=server.server_port)})
        answer = connection.getresponse()
        assert answer.status == status
        assert (b"secret" in answer.read()) == (status == 200)
        server.shutdown()


@pytest.mark.parametrize(("host", "port"), [("127.0.0.1", 70000), ("192.0.2.1", 0)])
def test_nowhere_to_listen_is_said(host, port):
    with pytest.raises(DmfcError, match="cannot listen on"):
        page_server(b"", host, port)
