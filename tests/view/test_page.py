"""The page in a real browser, a headless Chromium: what it shows, its keys, a narrow window, a lost connection."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from patience import wait_until
from watching import bucket, frame

from wdpm.images.channels import encode_srgb8
from wdpm.images.image import Image
from wdpm.images.view_transform import Look, ViewTransform, auto_exposure, shown_pixels
from wdpm.progress import SilentProgress
from wdpm.view.address import ViewAddress
from wdpm.view.live import LiveView

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: see the extra test")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")

pytestmark = [
    pytest.mark.sockets,
    pytest.mark.processes,
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="there is no Chromium with its driver"),
]

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1400,900",
)


class Browser:
    """A page that is looked at by scripts."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def run(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def until(self, script: str, expected: Any = True) -> None:
        """Wait until a script returns what is expected."""
        self._wait(lambda: self.run(f"return {script}") == expected, script)

    def key(self, key: str) -> None:
        self.run("document.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0], bubbles: true}))", key)

    def color(self, x: float, y: float) -> list[int]:
        """Of the canvas at shares of its width and height, once it is drawn."""
        return list(
            self.driver.execute_async_script(
                "const [x, y, done] = arguments; requestAnimationFrame(() => requestAnimationFrame(() => {"
                "const c = document.getElementById('canvas');"
                "const at = [c.width * x, c.height * y, 1, 1];"
                "done(Array.from(c.getContext('2d').getImageData(...at).data).slice(0, 3)) }))",
                x,
                y,
            )
        )

    def until_color(self, x: float, y: float, expected: list[int]) -> None:
        self._wait(lambda: np.abs(np.subtract(self.color(x, y), expected)).max() <= 2, f"{expected} at {x}, {y}")

    def complaints(self) -> list[str]:
        """What the page's scripts and the browser complained of."""
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        wait_until(condition, what)


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture
def stops() -> list[str]:
    return []


@pytest.fixture
def view(stops: list[str]) -> Iterator[LiveView]:
    """A render of an even image, half of which is there, beside a darker one."""
    beside = Image({"beauty": np.full((20, 32, 3), 0.25, np.float32)})
    view = LiveView(ViewAddress(), "a box", passes=True, beside=beside, stop=lambda: stops.append("stop"))
    view.begin(frame(32, 20))
    view.bucket(even(0, 16, 0.5))
    yield view
    view.close("done")


@pytest.fixture
def page(driver: Any, view: LiveView) -> Iterator[Browser]:
    driver.set_window_size(1400, 900)
    driver.get(view.url)
    browser = Browser(driver)
    browser.until("Boolean(window.wdpm && wdpm.pictures.a && wdpm.pictures.a.shown && wdpm.pictures.b.shown)")
    yield browser
    assert browser.complaints() == []


def even(x0: int, width: int, value: float) -> Any:
    """Pixels of one colour."""
    pixels = bucket(x0, 0, width, 20, 0.0)
    pixels.layers["beauty"][:] = value
    return pixels


GREY = {0.5: [188] * 3, 0.25: [137] * 3, 1.0: [255] * 3, 0.0: [0] * 3}
"""As sRGB shows it."""


def test_buckets_come(page: Browser, view: LiveView) -> None:
    page.until_color(0.45, 0.5, GREY[0.5])
    page.until_color(0.55, 0.5, GREY[0.0])
    view.bucket(even(16, 16, 0.25))
    page.until_color(0.55, 0.5, GREY[0.25])
    assert page.run("return wdpm.pictures.a.shown.at(20, 3)") == [0.25] * 3
    view.begin(frame(32, 20, first_sample=1))
    view.bucket(even(16, 16, 0.75))
    page.until_color(0.55, 0.5, GREY[0.5])


def test_keys_and_values(page: Browser) -> None:
    page.key("e")
    page.key("e")
    page.until_color(0.45, 0.5, GREY[1.0])
    page.key("E")
    page.key("E")
    page.key("f")
    page.until_color(0.45, 0.5, [61, 185, 116])  # viridis at 0.67: 4 decades up to 10
    assert page.run("return document.getElementById('high').textContent") == "10.00"
    page.key("f")
    page.key("w")
    page.until("Boolean(wdpm.look.cells && wdpm.look.cells.data)")
    page.until_color(0.1, 0.5, [int(188 * 0.6 + tint * 0.4) for tint in (230, 159, 0)])
    page.key("w")
    page.key("l")
    page.until("document.getElementById('layer').value", "cell")
    page.until("wdpm.pictures.a.shown && wdpm.pictures.a.shown.name", "cell")
    page.key("L")
    page.until("wdpm.pictures.a.shown && wdpm.pictures.a.shown.name", "beauty")
    before = page.run("return wdpm.stage.scale")
    page.key("+")
    assert page.run("return wdpm.stage.scale") == pytest.approx(2 * before)
    page.key("1")
    assert page.run("return wdpm.stage.scale") == 1
    page.key("0")
    assert page.run("return wdpm.stage.scale") == pytest.approx(before)
    page.run(
        "const c = document.getElementById('canvas');"
        "c.dispatchEvent(new PointerEvent('pointermove', {clientX: c.getBoundingClientRect().x + c.clientWidth * 0.4,"
        "clientY: c.getBoundingClientRect().y + c.clientHeight / 2}))"
    )
    assert page.run("return document.getElementById('pixel').textContent").endswith(
        "y 10  |  this 0.5000 0.5000 0.5000  |  other 0.2500 0.2500 0.2500"
    )


def test_exposure_and_view_transform(page: Browser, view: LiveView) -> None:
    view.look = Look(1.0)  # as --exposure, or the scene, says
    page.until("wdpm.look.exposure", 1)
    page.until_color(0.45, 0.5, GREY[1.0])
    page.key("a")
    assert page.run("return wdpm.look.exposure") == auto_exposure(np.full((1, 1, 3), 0.5, np.float32))
    page.key("t")
    assert page.run("return document.getElementById('transform').value") == "filmic"
    view.look = Look(None, ViewTransform.AGX)
    page.until("wdpm.look.transform", "agx")
    page.until_color(0.45, 0.5, list(shown_pixels(np.full((1, 1, 3), 0.18, np.float32), view.look)[0, 0]))


def test_the_page_shows_what_a_png_shows(page: Browser) -> None:
    random = np.random.default_rng(1)
    light = (2.0 ** random.uniform(-8, 4, (1, 200, 3))).astype(np.float32)
    for transform in ViewTransform:
        shown = page.driver.execute_async_script(
            "const [name, light, done] = arguments; import('./transforms.js').then((all) =>"
            "done(light.map((rgb) => all.TRANSFORMS[name](...rgb))))",
            transform.value,
            light[0].tolist(),
        )
        difference = encode_srgb8(np.array(shown)).astype(int) - shown_pixels(light, Look(0.0, transform))[0]
        assert np.abs(difference).max() <= 1
    found = page.driver.execute_async_script(
        "const [light, done] = arguments; import('./transforms.js').then((all) => done(all.autoExposure(light)))",
        light.ravel().tolist(),
    )
    assert found == pytest.approx(auto_exposure(light))


def test_ways_to_compare(page: Browser) -> None:
    page.key("d")
    page.until_color(0.45, 0.5, GREY[0.25])  # |0.5 - 0.25|
    page.key("x")
    page.until_color(0.45, 0.5, GREY[0.5])
    page.key("x")
    page.until_color(0.45, 0.5, GREY[0.25])
    page.run("const m = document.getElementById('mode'); m.value = 'swipe'; m.onchange({target: m})")
    page.until_color(0.45, 0.5, GREY[0.5])
    page.until_color(0.55, 0.5, GREY[0.25])
    page.run("const m = document.getElementById('mode'); m.value = 'side'; m.onchange({target: m})")
    page.until_color(0.2, 0.5, GREY[0.5])
    page.until_color(0.75, 0.5, GREY[0.25])


def test_what_stands_beside_the_image(page: Browser, view: LiveView, stops: list[str]) -> None:
    progress = view.following(SilentProgress())
    progress.start("render", 10)
    progress.advance(5)
    progress.note("slave 1 coughs")
    view.end(
        [{"busy_s": 3.0, "peak_memory_bytes": 2**30, "bytes_in": 2048, "bytes_out": 4096, "guards": {"cut": 2}}] * 2
    )
    page.until("document.getElementById('phase').textContent.startsWith('render, 5 of 10, about')")
    page.until("document.getElementById('notes').textContent", "slave 1 coughs")
    page.until("document.querySelectorAll('#rows li').length", 2)
    page.until(
        "document.querySelector('#rows li:last-child small:last-child').textContent",
        "busy 3 s, 1.0 GiB memory, 2.0 KiB in, 4.0 KiB out, 2 dropped or cut",
    )
    page.run("document.getElementById('enough').click()")
    page.until("document.getElementById('enough').textContent", "Ends after this pass")
    assert view.enough
    page.run("document.getElementById('stop').click()")
    assert page.run("return document.getElementById('stop').textContent") == "Really stop?"
    page.run("document.getElementById('stop').click()")
    page.until("document.getElementById('notes').lastChild.textContent", "stopped from the page")
    assert stops == ["stop"]


def test_a_narrow_window_has_all_of_it(page: Browser) -> None:
    page.driver.set_window_size(400, 850)
    page.until("innerWidth <= 400")
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    outside = (
        "return [...document.querySelectorAll('button, select, input, canvas, li')].filter((each) => {"
        "const box = each.getBoundingClientRect(); return box.width && (box.left < 0 || box.right > innerWidth) })"
        ".map((each) => each.id)"
    )
    assert page.run(outside) == []
    page.until_color(0.45, 0.5, GREY[0.5])


def test_the_end_is_said_and_the_image_stays(page: Browser, view: LiveView) -> None:
    view.close("done: the image is written")
    page.until("document.getElementById('banner').textContent.startsWith('a box: done: the image is written.')")
    page.until("document.getElementById('stop').disabled")
    page.until_color(0.45, 0.5, GREY[0.5])


def test_a_lost_connection_is_said_and_made_again(page: Browser) -> None:
    page.run(
        "window.said = []; const banner = document.getElementById('banner');"
        "new MutationObserver(() => said.push(banner.textContent)).observe(banner, {childList: true, subtree: true});"
        "wdpm.socket.close()"
    )
    page.until("said.some((text) => text.startsWith('Connection lost'))")  # however soon it is made again
    page.until("document.getElementById('banner').hidden")
    page.until_color(0.45, 0.5, GREY[0.5])


def test_the_page_is_listed_whole() -> None:
    from wdpm.view.server import PAGE

    folder = Path(__file__).resolve().parents[2] / "wdpm" / "view" / "page"
    assert sorted(path.name for path in folder.iterdir()) == sorted(name for name, _ in PAGE.values())
