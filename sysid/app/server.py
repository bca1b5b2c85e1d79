"""The page's address: this machine alone, and only for who has the token.

Every request, the websocket's among them, passes one gate before it reaches a handler: it must name
this address as its host (which a foreign name that points here does not), come from this page where
it says from where, and bring the token, in the address at first and in a cookie from then on.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from importlib import import_module, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import tornado.web
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerConnectionDelegate, HTTPServerRequest

from sysid.errors import InputError, input_error
from sysid.io import bounds

if TYPE_CHECKING:
    from sysid.app.workbench import Workbench

ADDRESS = "127.0.0.1"
PAGE = "/workbench"
_TEMPLATES = resources.files("sysid.app") / "templates"
# What may be given out of a folder, and as what.
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".h": "text/plain; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".mat": "application/octet-stream",
    ".fmu": "application/octet-stream",
    ".xml": "text/xml; charset=utf-8",
}


def template_text(name: str) -> str:
    """A file of the page's templates."""
    return (_TEMPLATES / name).read_text("utf-8")


class Gate:
    """Who may pass: `token` in the query or, under `cookie`'s name, in a cookie."""

    def __init__(self, port: int) -> None:
        self.token = secrets.token_urlsafe(32)
        self.cookie = f"sysid-app-{port}"
        self.hosts = {f"{ADDRESS}:{port}", f"localhost:{port}"}

    def refuses(self, request: HTTPServerRequest) -> str:
        """Why a request is refused; empty where it may pass."""
        if request.headers.get("Host", "") not in self.hosts:
            return "this address is reached by another name"
        origin = request.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "the request comes from another page"
        site = request.headers.get("Sec-Fetch-Site", "none")
        if site not in ("none", "same-origin") and request.path != "/":
            return "the request comes from another page"
        given = [value.decode("latin-1") for value in request.arguments.get("token", [])]
        if self.cookie in request.cookies:
            given.append(request.cookies[self.cookie].value)
        if not any(hmac.compare_digest(one.encode(), self.token.encode()) for one in given):
            return "the token is missing or wrong: open the address that `sysid app` printed"
        return ""


class _Refused(tornado.web.RequestHandler):
    """The answer to who may not pass."""

    def initialize(self, why: str) -> None:
        self.why = why

    def prepare(self) -> None:
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"403: {self.why}\n")


class _Entry(tornado.web.RequestHandler):
    """The address that is printed: keeps the token in a cookie, and goes on to the page."""

    def initialize(self, gate: Gate) -> None:
        self.gate = gate

    def get(self) -> None:
        self.set_cookie(self.gate.cookie, self.gate.token, httponly=True, samesite="Strict")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cache-Control", "no-store")
        self.finish(template_text("entry.html"))


class _Alive(tornado.web.RequestHandler):
    """Whether the program runs still."""

    def get(self) -> None:
        self.finish("ok")


class _Starting(tornado.web.RequestHandler):
    """The answer, to all but the entry, while the workbench is being imported."""

    def prepare(self) -> None:
        self.set_status(503)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish("503: the workbench is starting\n")


class _Style(tornado.web.RequestHandler):
    """The page's own style, which each of its parts imports."""

    def get(self) -> None:
        from sysid.blocks.html import template_text as block_text

        self.set_header("Content-Type", "text/css; charset=utf-8")
        self.set_header("Cache-Control", "max-age=3600")
        self.finish(template_text("style.css") + block_text("phone.css"))


class _Results(tornado.web.RequestHandler):
    """Files that commands wrote, to look at or to keep. A page among them can do nothing here."""

    def initialize(self, bench: Workbench) -> None:
        self.bench = bench

    def get(self, name: str) -> None:
        folder = self.bench.folder.resolve()
        path = (folder / name).resolve()
        if not path.is_relative_to(folder) or path.suffix not in _TYPES or not path.is_file():
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", _TYPES[path.suffix])
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Content-Security-Policy", "sandbox allow-scripts allow-popups")
        if path.suffix != ".html":
            self.set_header("Content-Disposition", f'attachment; filename="{path.name}"')
        self.finish(path.read_bytes())


@tornado.web.stream_request_body
class _Upload(tornado.web.RequestHandler):
    """A file that is dropped on the page, written into the campaign's folder as it comes.

    It is no longer than the readers take, replaces nothing, and is whole or not there.
    """

    def initialize(self, bench: Workbench) -> None:
        self.bench = bench

    def prepare(self) -> None:
        most = bounds.most_bytes()
        self.request.connection.set_max_body_size(most)  # type: ignore[union-attr]
        self.part: Path | None = None
        self.why = ""
        length = int(self.request.headers.get("Content-Length", 0))
        try:
            self.path = self._free(unquote(self.request.path.rpartition("/")[2]))
            bounds.check_length(self.path, length)
        except InputError as error:
            self._refuse(str(error))
            return
        self.part = self.path.with_name(f".sysid-{secrets.token_hex(6)}.tmp")
        self.file = self.part.open("xb")

    def _free(self, given: str) -> Path:
        """Where a file of this name goes: its name alone, and none that is there."""
        name = Path(given.replace("\\", "/")).name
        if not name or name.startswith(".") or not name.isprintable() or len(name.encode()) > 200:
            raise input_error(given[:60] or "a file", "has no usable name", "rename it")
        if Path(name).suffix.lower() in (".toml", ".py"):
            raise input_error(name, "is no recording", "put it into the folder yourself")
        path, number = self.bench.folder / name, 2
        while path.exists():
            stem = Path(name)
            path = self.bench.folder / f"{stem.stem}-{number}{stem.suffix}"
            number += 1
        return path

    def _refuse(self, why: str) -> None:
        self.why = why
        self.set_status(400)
        self.finish(why)

    def data_received(self, chunk: bytes) -> None:
        if self.part is not None:
            self.file.write(chunk)

    def put(self, _: str) -> None:
        if self.part is None:
            return
        self.file.close()
        self.part.rename(self.path)
        self.part = None
        self.finish(self.path.name)

    def on_connection_close(self) -> None:
        self.on_finish()

    def on_finish(self) -> None:
        if self.part is not None:
            self.file.close()
            self.part.unlink(missing_ok=True)


def _free_port(port: int) -> socket.socket:
    """A socket on this machine's own address; `port` 0: any. Raises InputError."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((ADDRESS, port))
    except OSError as error:
        found.close()
        fix = "give another with --port, or none"
        raise input_error(f"--port {port}", error.strerror or "is in use", fix) from None
    return found


def serve(
    make: Callable[[], Workbench], port: int, tell: Callable[[str], None], *, opens_browser: bool
) -> None:
    """Serve the workbench that `make` gives until Ctrl-C.

    `tell` is called with the address, once that answers; only then is the workbench imported, and
    made, in a thread. Raises InputError where the port cannot be had.
    """
    probe = _free_port(port)
    taken = probe.getsockname()[1]
    probe.close()
    gate = Gate(taken)
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    door = _Door(_early(gate))
    HTTPServer(door).listen(taken, ADDRESS)
    address = f"http://{ADDRESS}:{taken}/?token={gate.token}"
    tell(address)
    if opens_browser:
        loop.call_soon(webbrowser.open, address)
    bench: Workbench | None = None
    try:
        # Ctrl-C stops the loop, or is raised in it.
        with contextlib.suppress(KeyboardInterrupt):
            bench = loop.run_until_complete(_made(make))
            server = _server(bench, gate)
            # Behind the same door: nobody is refused while one follows the other.
            server._http.stop()
            door.application = server._tornado
            server.start()
            loop.run_forever()
    finally:
        if bench is not None:
            bench.close()


async def _made(make: Callable[[], Workbench]) -> Workbench:
    """The workbench, with all that its page needs imported; the loop goes on meanwhile."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Workbench] = loop.create_future()

    def tell(error: BaseException | None, bench: Workbench | None) -> None:
        if error is not None:
            done.set_exception(error)
        elif bench is not None:
            done.set_result(bench)

    def work() -> None:
        try:
            bench = make()
            for name in ("sysid.app.page", "panel.io.server"):
                import_module(name)
        except BaseException as error:
            loop.call_soon_threadsafe(tell, error, None)
        else:
            loop.call_soon_threadsafe(tell, None, bench)

    # Not the loop's own threads: they would keep a program that is ended meanwhile.
    threading.Thread(target=work, daemon=True).start()
    return await done


class _Door(HTTPServerConnectionDelegate):
    """Gives each request to the application that is behind the address by then."""

    def __init__(self, application: Any) -> None:
        self.application = application

    def start_request(self, server_conn: object, request_conn: Any) -> Any:
        """Who answers a request."""
        return self.application.start_request(server_conn, request_conn)


def _early(gate: Gate) -> tornado.web.Application:
    """What answers at the address until the workbench is there."""
    application = tornado.web.Application([(r"/", _Entry, {"gate": gate}), (r".*", _Starting)])
    _guard(application, gate)
    return application


def _guard(application: Any, gate: Gate) -> None:
    """Let nothing reach the application's handlers that the gate refuses."""
    known = application.find_handler

    def find_handler(request: HTTPServerRequest, **options: Any) -> Any:
        why = gate.refuses(request)
        if why:
            return application.get_handler_delegate(request, _Refused, {"why": why})
        return known(request, **options)

    application.find_handler = find_handler


def _server(bench: Workbench, gate: Gate) -> Any:
    """Panel's server with the gate before it, at a port that does not matter."""
    page = import_module("sysid.app.page")
    server: Any = import_module("panel.io.server").get_server(
        {PAGE: lambda: page.window(bench)},
        port=0,
        address=ADDRESS,
        websocket_origin=sorted(gate.hosts),
        start=False,
        show=False,
        title="sysid",
        index=None,
        use_index=False,
        redirect_root=False,
        check_unused_sessions_milliseconds=5_000,
        unused_session_lifetime_milliseconds=60_000,
        session_token_expiration=24 * 3600,
        extra_patterns=[
            (r"/", _Entry, {"gate": gate}),
            (r"/alive", _Alive),
            (r"/style\.css", _Style),
            (r"/files/(.*)", _Results, {"bench": bench}),
            (r"/upload/(.*)", _Upload, {"bench": bench}),
        ],
    )
    _guard(server._tornado, gate)
    return server


__all__ = ["ADDRESS", "Gate", "serve", "template_text"]
