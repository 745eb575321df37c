"""`--tev`: what tev is sent decodes as its source says, changes no bit, and costs nothing when tev goes away."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from command_line import refusal
from free_ports import free_port
from patience import WAIT_S, wait_until
from tev_server import TevServer

from wdpm.cli import main
from wdpm.cluster.display import Bucket, Frame
from wdpm.images.image import Image, load
from wdpm.tev import connection
from wdpm.tev.display import TevDisplay
from wdpm.tev.packets import create_image, update_image
from wdpm.view.address import ViewAddress

SMALL = ["render", "cornell-box", "--size", "16x12", "--photons", "500", "--indirect", "map", "-q", "--bucket", "8"]

pytestmark = [pytest.mark.sockets, pytest.mark.processes]


def channels_of(layer: str) -> list[str]:
    return ["R", "G", "B"] if layer == "beauty" else [f"{layer}.{name}" for name in "RGB"]


def test_tev_has_the_image_at_the_end(tmp_path: Path) -> None:
    plain, sent = tmp_path / "plain.exr", tmp_path / "sent.exr"
    assert main.main([*SMALL, "--spp", "2", "-o", str(plain)]) == 0
    with TevServer() as tev:
        assert main.main([*SMALL, "--spp", "2", "-o", str(sent), "--tev", tev.address]) == 0
    image = load(sent)
    assert image.digest() == load(plain).digest()
    shown = tev.images["cornell-box"].channels
    for layer in ("beauty", "direct", "indirect", "albedo"):
        planes = np.stack([shown[name] for name in channels_of(layer)], axis=2)
        np.testing.assert_array_equal(planes, image.layers[layer])
    np.testing.assert_array_equal(shown["depth.Z"], image.layers["depth"])
    assert tev.updates == 4  # 2 x 2 buckets


def test_passes_are_averaged(tmp_path: Path) -> None:
    out = tmp_path / "out.exr"
    with TevServer() as tev:
        assert main.main([*SMALL, "--spp", "6", "--passes", "3", "-o", str(out), "--tev", tev.address]) == 0
    shown = tev.images["cornell-box"].channels
    planes = np.stack([shown[name] for name in "RGB"], axis=2)
    np.testing.assert_allclose(planes, load(out).pixels, rtol=1e-4, atol=1e-6)


def test_a_viewer_that_goes_away_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The render waits until it has gone, and after each pass until all was sent: it cannot be over before that."""
    out, plain = tmp_path / "out.exr", tmp_path / "plain.exr"
    loud = [each for each in SMALL if each != "-q"]
    with TevServer(packets=2) as tev:

        def pass_done(display: TevDisplay, _: object) -> None:
            assert tev.gone.wait(WAIT_S)
            wait_until(lambda: not display._places or not display._sender.is_alive())

        monkeypatch.setattr(TevDisplay, "pass_done", pass_done)
        arguments = [*loud, "--spp", "12", "--passes", "6", "-o", str(out), "--tev", tev.address]
        assert main.main(arguments) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "tev" in line]
    assert len(lines) == 1
    assert f"wdpm: tev at {tev.address} is shown no more: " in lines[0]
    assert lines[0].endswith("; the render goes on")
    assert main.main([*SMALL, "--spp", "12", "--passes", "6", "-o", str(plain)]) == 0
    assert load(out).digest() == load(plain).digest()


def test_a_viewer_that_takes_nothing_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "SEND_S", WAIT_S)  # were it waited for, it would be for so long
    monkeypatch.setattr("wdpm.tev.display.FLUSH_S", 0.5)
    with TevServer(deaf=True) as tev:
        display = TevDisplay(ViewAddress("127.0.0.1", tev.port), "large")
        size = 2048  # more than sockets hold
        display.begin(Frame(size, size, {"beauty": 3}, 0, 1, (0,), ("one",)))
        display.bucket(Bucket(0, 0, {"beauty": np.ones((size, size, 3), np.float32)}, 0))
        began = time.monotonic()
        display.close()
        assert time.monotonic() - began < connection.SEND_S
        display._sender.join(WAIT_S)
        assert not display._sender.is_alive()
        assert display.complaint() is None  # the render had ended


def test_a_viewer_that_takes_nothing_for_long_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "SEND_S", 0.2)
    with TevServer(deaf=True) as tev:
        display = TevDisplay(ViewAddress("127.0.0.1", tev.port), "large")
        size = 2048
        display.begin(Frame(size, size, {"beauty": 3}, 0, 1, (0,), ("one",)))
        display.bucket(Bucket(0, 0, {"beauty": np.ones((size, size, 3), np.float32)}, 0))
        display._sender.join(WAIT_S)
        assert "is shown no more: timed out; the render goes on" in (display.complaint() or "")
        assert display.complaint() is None  # it is said once
        display.close()


def test_what_is_asked_for_before_tev_runs_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    address = f"127.0.0.1:{free_port()}"
    assert main.main([*SMALL, "--tev", address]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"wdpm: error: tev does not answer at {address}: connection refused; start it first")
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*SMALL, "--tev", "there"], "'there' is no HOST:PORT"),
        ([*SMALL, "--tev", "127.0.0.1:1", "--replay", "1,1,0"], "--replay makes no image that --tev could show"),
        (["view", "none.exr", "--tev", "127.0.0.1:1"], "none.exr: no such file"),
        (["view", "none.exr", "--tev", "127.0.0.1:1", "--view-at", "1"], "--view-at is where a page is served"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert message in refusal(arguments, capsys)


def test_files_are_opened(tmp_path: Path) -> None:
    files = [tmp_path / "one.exr", tmp_path / "other.exr"]
    for file in files:
        Image({"beauty": np.zeros((2, 2, 3), np.float32)}).save(file)
    with TevServer() as tev:
        assert main.main(["view", *map(str, files), "--tev", tev.address]) == 0
    assert tev.opened == [(str(file), "") for file in files]


def test_packets_are_those_of_the_source() -> None:
    """Bytes as OStream of include/tev/Ipc.h writes them, put down by hand."""
    created = bytes.fromhex("1c000000 04 01 696d6700 03000000 02000000 02000000 5200 642e5a00")
    assert create_image("img", 3, 2, ["R", "d.Z"]) == created
    pixels = np.array([[[1.0, 2.0]]], np.float32)
    head = "4c000000 06 00 696d6700 02000000 5200 642e5a00 05000000 07000000 01000000 01000000"
    rest = "0000000000000000 0100000000000000 0200000000000000 0200000000000000 0000803f 00000040"
    assert update_image("img", 5, 7, ["R", "d.Z"], pixels) == bytes.fromhex(head + rest)
    with pytest.raises(ValueError, match="2 channels, but 1"):
        update_image("img", 0, 0, ["R"], pixels)
