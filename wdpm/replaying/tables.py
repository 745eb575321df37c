"""A replay of a sample as tables on the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wdpm.replaying.vertices import LAYERS, Collision, Gather, Hit, Replay, ReplayVertex, ShadowRay


def print_replay(replay: Replay, console: Console) -> None:
    """Print a table for each vertex, and the sum."""
    for vertex in replay.vertices:
        title = f"Vertex {vertex.bounce}" + ("" if vertex.hit or vertex.collision else ": nothing is hit")
        console.print(f"\n[bold]{title}[/]", highlight=False)
        console.print(_vertex(vertex, len(replay.vertices[0].direct)))
    title = f"Sample {replay.sample} of pixel {replay.x},{replay.y}: what it adds [W / (sr m²)]"
    console.print(f"\n[bold]{title}[/]", highlight=False)
    table = _table()
    for name in LAYERS:
        table.add_row(name, _numbers(replay.layers[name].tolist(), 9))
    table.add_row("beauty", _numbers(replay.value.tolist(), 9))
    console.print(table)
    acted = ", ".join(f"{count:,} {cause}" for cause, count in replay.guards.items())
    console.print(f"[red]guards: {escape(acted)}[/]" if acted else "guards: none acted", highlight=False)


def _vertex(vertex: ReplayVertex, light_samples: int) -> Table:
    table = _table()
    for name, text in (
        *_arrival(vertex),
        *_place(vertex.hit),
        *_collision(vertex.collision),
        *_light(vertex, light_samples),
    ):
        table.add_row(name, escape(text))
    if vertex.onward is not None:
        onward = vertex.onward
        table.add_row("goes on", f"in direction {_numbers(onward.direction)}")
        table.add_row("", f"throughput {_numbers(onward.throughput)}, pdf {onward.pdf:.6g}")
        table.add_row("", escape(f"medium {onward.medium or 'none'}"))
    else:
        table.add_row("goes on", "no")
    return table


def _arrival(vertex: ReplayVertex) -> Iterator[tuple[str, str]]:
    yield "arrives", f"throughput {_numbers(vertex.throughput)}"
    yield "", f"edges {vertex.edges}, medium {vertex.medium or 'none'}"


def _place(hit: Hit | None) -> Iterator[tuple[str, str]]:
    if hit is None:
        return
    yield "mesh", f'"{hit.mesh}", triangle {hit.triangle} (number {hit.prim} of the scene)'
    yield "material", f'"{hit.material}", {hit.leaf}, seen from the {"front" if hit.front else "back"}'
    yield "", f"color {_numbers(hit.color)}, specular {_numbers(hit.specular)}, alpha {_numbers(hit.alpha)}"
    yield "position", f"{_numbers(hit.position, 9)}; u {hit.u:.6g}, v {hit.v:.6g}"
    yield "distance", f"{hit.distance:.9g} (t = {hit.t:.9g})"
    yield "normal", f"{_numbers(hit.normal)}; for shading {_numbers(hit.shading_normal)}"


def _collision(collision: Collision | None) -> Iterator[tuple[str, str]]:
    if collision is None:
        return
    yield "collides", f'in medium "{collision.medium}"'
    yield "position", _numbers(collision.position, 9)
    yield "distance", f"{collision.distance:.9g}"


def _light(vertex: ReplayVertex, light_samples: int) -> Iterator[tuple[str, str]]:
    yield "emission", _numbers(vertex.emission)
    for shadow in vertex.direct:
        shared = f" (counts 1/{light_samples})" if vertex.bounce == 0 and light_samples > 1 else ""
        yield "direct", _shadow(shadow) + shared
    for name, gather in (("indirect", vertex.indirect), ("caustic", vertex.caustic)):
        if gather is not None:
            yield name, _gather(gather)
    if any(vertex.volume):
        yield "volume", _numbers(vertex.volume)


def _shadow(shadow: ShadowRay) -> str:
    light = "no light" if shadow.light is None else f'light "{shadow.light}"'
    passes = f", through {shadow.passes} surfaces" if shadow.passes else ""
    if not any(shadow.carries):
        return f"{light}: carries nothing"
    if shadow.arrives is None:
        return f"{light}{passes}: blocked; it carries {_numbers(shadow.carries)}"
    lost = f" of {_numbers(shadow.carries)}" if shadow.arrives != shadow.carries else ""
    return f"{light}{passes}: {_numbers(shadow.arrives)}{lost}"


def _gather(gather: Gather) -> str:
    few = ", fewer than k" if gather.truncated else ""
    return f"{_numbers(gather.radiance)}: {gather.photons} photons within {gather.radius:.6g}{few}"


def _numbers(values: Sequence[float], digits: int = 6) -> str:
    return " ".join(f"{value:.{digits}g}" for value in values)


def _table() -> Table:
    """A table without lines or heads: what, and its figures."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    return table
