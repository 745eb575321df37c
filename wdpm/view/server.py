"""The page's server: a thread of its own with an event loop, so that the render never waits for a browser."""

from __future__ import annotations

import asyncio
import functools
import logging
import secrets
import tempfile
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from aiohttp.http import HttpProcessingError

from wdpm.images.image import Image
from wdpm.scenes.errors import ImageError, SettingsError
from wdpm.view.address import ViewAddress
from wdpm.view.picture import Picture, Rectangle
from wdpm.view.requests import BadRequestError, ViewRequest, read_request
from wdpm.view.viewers import Viewer

PAGE = {
    "": ("index.html", "text/html"),
    "view.css": ("view.css", "text/css"),
    "main.js": ("main.js", "text/javascript"),
    "pixels.js": ("pixels.js", "text/javascript"),
    "stage.js": ("stage.js", "text/javascript"),
    "panel.js": ("panel.js", "text/javascript"),
    "transforms.js": ("transforms.js", "text/javascript"),
}
"""Path under the token -> file in page/, and its type. Nothing else is served."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}

LONGEST_REQUEST = 4096
"""Bytes of a page's message."""

MOST_CONNECTIONS = 512
"""With visitors, whether they know the token or not; a browser takes up to seven for a page."""

AT_ONCE = 16
"""Connections that are taken before it is asked how many there are."""

FAREWELL_S = 2.0
"""How long pages may take for the last pixels."""

LOG = logging.getLogger(__name__)
"""Where errors of this server go."""


def _is_of_the_server(record: logging.LogRecord) -> bool:
    """Whether an error is no visitor's: one who speaks no HTTP is answered with 400, one who is gone with nothing."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError | ConnectionError))


LOG.addFilter(_is_of_the_server)

WRONG_TOKEN = "wrong address: open the whole one that wdpm printed, token included\n"


class ViewServer:
    """Serves pictures and a status to any number of pages.

    Args:
        address: where to listen.
        pictures: "a", and perhaps "b" to compare it with.
        status: what else the page shows, as JSON has it; called on this server's thread.
        act: does what a page asks for beyond pixels; called on this server's thread.

    Raises:
        SettingsError: it cannot listen there.
    """

    def __init__(
        self,
        address: ViewAddress,
        pictures: Mapping[str, Picture],
        status: Callable[[], dict[str, Any]],
        act: Callable[[str], None],
    ) -> None:
        self._pictures = pictures
        self._status = status
        self._act = act
        self._token = secrets.token_urlsafe(16)
        self._viewers: set[Viewer] = set()
        self._sockets: dict[web.WebSocketResponse, asyncio.Transport | None] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="wdpm view", daemon=True)
        self._thread.start()
        try:
            self.address = self._call(self._listen(address)).result()
        except OSError as error:
            self._end_loop()
            said = (error.strerror or str(error)).rpartition("): ")[
                2
            ]  # "error while ... (HOST, PORT): no such address"
            reason = "the port is taken" if error.errno is not None and "in use" in said else said
            raise SettingsError(
                f"the view cannot listen at {address}: {reason}; give another by --view-at HOST:PORT, port 0 for any "
                "that is free"
            ) from None
        self.url = self.address.url(self._token)

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._viewers)

    def changed(self, places: Sequence[Rectangle]) -> None:
        """Pixels of picture "a" are others now; from any thread. Costs next to nothing where nobody looks."""
        if self._viewers:
            self._loop.call_soon_threadsafe(self._tell_changed, places)

    def hurry(self) -> None:
        """Have every page told the status now; from any thread."""
        if self._viewers:
            self._loop.call_soon_threadsafe(self._tell_status)

    def close(self) -> None:
        """Send every page what it lacks, and end; may be called again."""
        if self._loop.is_closed():
            return
        self._call(self._shut()).result()
        self._end_loop()

    # On the loop.

    def _call(self, what: Any) -> Future[Any]:
        return asyncio.run_coroutine_threadsafe(what, self._loop)

    def _end_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _tell_changed(self, places: Sequence[Rectangle]) -> None:
        for viewer in self._viewers:
            viewer.changed(places)

    def _tell_status(self) -> None:
        for viewer in self._viewers:
            viewer.hurry()

    async def _listen(self, address: ViewAddress) -> ViewAddress:
        application = web.Application(middlewares=[self._guarded])
        application.router.add_get(f"/{self._token}/socket", self._socket)
        application.router.add_get(f"/{self._token}/now.exr", self._exr)
        application.router.add_get(f"/{self._token}", self._without_slash)
        for path in PAGE:
            application.router.add_get(f"/{self._token}/{path}", self._page)
        self._runner = web.AppRunner(
            application, access_log=None, logger=LOG, handle_signals=False, shutdown_timeout=FAREWELL_S
        )
        await self._runner.setup()
        try:
            self._listener = await self._loop.create_server(self._admitted, address.host, address.port, backlog=AT_ONCE)
        except OSError:
            await self._runner.cleanup()
            raise
        return replace(address, port=self._listener.sockets[0].getsockname()[1])

    def _admitted(self) -> asyncio.BaseProtocol:
        """Who has come is served; one too many is hung up on: without files to open, the render would end."""
        server = self._runner.server
        assert server is not None
        return server() if len(server.connections) < most_connections() else _TooMany()

    async def _shut(self) -> None:
        self._listener.close()
        farewells = [asyncio.wait_for(viewer.flush(), FAREWELL_S) for viewer in list(self._viewers)]
        await asyncio.gather(*farewells, return_exceptions=True)  # who is gone or too slow misses the end
        goodbyes = [asyncio.wait_for(socket.close(), FAREWELL_S) for socket in self._sockets]
        await asyncio.gather(*goodbyes, return_exceptions=True)
        # A browser that takes nothing any more (a tab that sleeps, a debugger) would never take the last word either.
        for transport in self._sockets.values():
            if transport is not None:
                transport.abort()
        await self._runner.cleanup()

    @web.middleware
    async def _guarded(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Who does not know the token learns nothing; pages of other sites reach nothing."""
        token = request.path.removeprefix("/").partition("/")[0]  # a proxy's requests may have a path without any "/"
        if not secrets.compare_digest(token.encode(errors="replace"), self._token.encode()):
            return web.Response(status=403, text=WRONG_TOKEN, headers=HEADERS)
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.host}":
            return web.Response(status=403, text="pages of other sites may not look\n", headers=HEADERS)
        return await handler(request)

    async def _page(self, request: web.Request) -> web.Response:
        name, kind = PAGE[request.path.rsplit("/", 1)[1]]
        return web.Response(text=page_file(name), content_type=kind, headers=HEADERS)

    async def _without_slash(self, _: web.Request) -> web.Response:
        """A URL that was copied but for its last character: what the page names is looked up under it."""
        return web.Response(status=302, headers={**HEADERS, "Location": f"/{self._token}/"})

    async def _exr(self, _: web.Request) -> web.Response:
        try:
            data = await asyncio.to_thread(_exr_of, self._pictures["a"])
        except ImageError as error:
            return web.Response(status=409, text=f"{error}\n", headers=HEADERS)
        return web.Response(body=data, content_type="image/x-exr", headers=HEADERS)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(max_msg_size=LONGEST_REQUEST, heartbeat=20.0, compress=False)
        await socket.prepare(request)
        viewer = Viewer(socket, self._pictures, self._status)
        sending = asyncio.create_task(viewer.send())
        self._viewers.add(viewer)
        self._sockets[socket] = request.transport
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    await self._take(message.data, viewer, socket)
        finally:
            self._viewers.discard(viewer)
            del self._sockets[socket]
            sending.cancel()
            # Whatever ended it, the browser is gone or goes: nobody is left to tell.
            await asyncio.gather(sending, return_exceptions=True)
        return socket

    async def _take(self, text: str, viewer: Viewer, socket: web.WebSocketResponse) -> None:
        """Do what a page asks for."""
        try:
            asked: ViewRequest = read_request(text, self._pictures)
        except BadRequestError as error:
            await socket.send_json({"kind": "refused", "reason": str(error)})
            return
        if asked.action is None:
            viewer.want(asked.wants)
        else:
            self._act(asked.action)


class _TooMany(asyncio.Protocol):
    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


def most_connections() -> int:
    """How many there may be: half of the files and sockets that this process may open are the render's."""
    try:
        import resource
    except ModuleNotFoundError:  # POSIX alone has it
        return MOST_CONNECTIONS
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST_CONNECTIONS if limit == resource.RLIM_INFINITY else min(MOST_CONNECTIONS, limit // 2)


@functools.cache
def page_file(name: str) -> str:
    """A file of the page."""
    return resources.files("wdpm.view").joinpath("page", name).read_text(encoding="utf-8")


def _exr_of(picture: Picture) -> bytes:
    """What is shown now, as a file. Raises ImageError if there is nothing yet."""
    layers = {name: layer.copy() for name, layer in picture.layers.items()}
    image = Image(layers, {"unfinished": f"saved from the view; {picture.spp} samples a pixel are complete"})
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "now.exr")
            image.save(path)
            return path.read_bytes()
    except OSError as error:
        raise ImageError(f"no file can be written where temporary ones go: {error.strerror}") from None
