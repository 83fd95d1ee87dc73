"""`luxmeter reference`: one path-traced image with its variance."""

from __future__ import annotations

import json as codec
from typing import Annotated

import typer

from jobs.files import whole, write_text
from jobs.process import Limits, run_task
from jobs.scenes import open_scene
from jobs.store import Store
from jobs.tasks import ReferenceTask
from renderers import TRANSPORTS
from renderers.images import read_exr, write_png
from service import parse
from service.options import Force, Json, MaxSeconds, Memory, Out, Quiet, Size, Timeout, in_bytes
from service.output import check_free, print_json, staged
from service.progress import task_progress

PIXEL_MODES = ("centre", "box")


def reference(
    scene: Annotated[str, typer.Argument(help="Built-in scene (name:parameter=value,…), file, or folder under LUXMETER_SCENES.")],
    out: Out,
    transport: Annotated[str, typer.Option(help=f"Light paths: {', '.join(TRANSPORTS)}.")] = "full",
    size: Size = "320x180",
    noise: Annotated[float, typer.Option(help="Wanted relative noise, 0 to 1: sqrt(mean variance) / mean luminance.")] = 0.02,
    pixel: Annotated[str, typer.Option(help="centre: paths start at the pixel centre; box: anywhere in the pixel.")] = "centre",
    frame: Annotated[int, typer.Option(min=0, help="Frame of an animated scene.")] = 0,
    max_seconds: MaxSeconds = None,
    timeout: Timeout = None,
    memory: Memory = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Path-trace SCENE to OUT/reference.exr (mean, variance), reference.png and reference.json. References are cached."""
    pixels = parse.size(size)
    parse.choice("--transport", transport, TRANSPORTS)
    parse.choice("--pixel", pixel, PIXEL_MODES)
    parse.share("--noise", noise)
    named = open_scene(scene)
    named.scene.world(frame)
    check_free(out, force=force)
    store = Store()
    with staged(out, force=force) as folder, task_progress(f"reference {transport} {named.name}", quiet) as progress:
        task = ReferenceTask.model_validate(
            {
                "id": "reference", "scene": named.text, "scene_name": named.name, "transport": transport, "pixel": pixel,
                "frame": frame, "size": pixels, "noise": noise, "max_seconds": max_seconds, "image": "reference.exr",
                "folder": folder, "cache": store.references,
            }
        )  # fmt: skip
        answer = run_task(task, Limits(timeout, in_bytes(memory)), progress)
        exposure = named.scene.exposure or store.exposure(named.scene.hash) or answer["exposure"]
        if transport == "full" and pixel == "centre" and frame == 0:
            exposure = named.scene.exposure or store.keep_exposure(named.scene.hash, answer["exposure"])
        with whole(folder / "reference.png") as path:
            write_png(path, read_exr(folder / "reference.exr")[0]["mean"], exposure)
        extra = {"scene_hash": answer["scene_hash"], "width": pixels[0], "height": pixels[1], "exposure": exposure}
        document = answer["info"] | extra
        write_text(folder / "reference.json", codec.dumps(document, indent=2) + "\n")
    if json:
        print_json(document)
    else:
        print(out)
