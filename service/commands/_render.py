"""`luxmeter render`: one scene, one method, one or several frames."""

from __future__ import annotations

import json as codec
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from jobs.files import whole, write_text
from jobs.pilot import wants_pilot
from jobs.process import Limits, run_task
from jobs.scenes import open_scene
from jobs.settings import dump, validate
from jobs.store import Store
from jobs.tasks import FrameOutput, PilotTask, RenderTask
from renderers import Scene, get_method
from renderers.images import luminance, read_exr, write_png
from reports.stored import read_pictures
from service import parse
from service.options import Force, Frames, Json, Memory, Out, Quiet, Size, Timeout, in_bytes
from service.output import check_free, print_json, staged
from service.progress import task_progress


def render(
    scene: Annotated[str, typer.Argument(help="Built-in scene (name:parameter=value,…), file, or folder under LUXMETER_SCENES.")],
    method: Annotated[str, typer.Option(help="Name of a method, see `luxmeter methods`.")],
    out: Out,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="K=V", help="A setting of the method.")] = None,
    size: Size = "320x180",
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    frames: Frames = "0:0",
    repeats: Annotated[int, typer.Option(min=1, max=100, help="Timed renders of each frame; timings are medians.")] = 1,
    timeout: Timeout = None,
    memory: Memory = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Render SCENE to OUT/frame.exr, frame.png and result.json; a range of frames to frame.0000.exr … and one result.json.

    A method's diagnostic pictures go to frame.NAME.png.
    """
    first, last = parse.frames(frames)
    pixels = parse.size(size)
    chosen = get_method(method)
    wanted = validate(chosen, parse.assignments(settings or ()))
    named = open_scene(scene)
    chosen.check(named.scene)
    named.scene.world(first)
    check_free(out, force=force)
    names = ["frame"] if first == last else [f"frame.{n:04d}" for n in range(first, last + 1)]
    outputs = [FrameOutput(frame=first + k, image=f"{n}.exr", result=f".{n}.json") for k, n in enumerate(names)]
    limits = Limits(timeout, in_bytes(memory))
    pilot = "pilot.json" if wants_pilot(chosen, wanted) else None
    with staged(out, force=force) as folder, task_progress(f"{method} {named.name}", quiet) as progress:
        common: dict[str, Any] = {"scene": named.text, "method": method, "settings": dump(wanted), "size": pixels, "folder": folder}
        if pilot is not None:
            run_task(PilotTask(**common, output=pilot), limits, progress)
        task = RenderTask(
            **common, scene_name=named.name, label=method, settings_file=pilot, seed=seed, repeats=repeats, outputs=tuple(outputs)
        )
        run_task(task, limits, progress)
        rows = _collect(folder, outputs)
        exposure = _exposure(named.scene, _beauty(folder / outputs[0].image))
        for output in outputs:
            image = folder / output.image
            with whole(image.with_suffix(".png")) as path:
                write_png(path, _beauty(image), exposure)
            for picture in read_pictures(image):
                with whole(image.with_suffix(f".{picture.name}.png")) as path:
                    write_png(path, picture.pixels, exposure=1.0)
        document = rows[0] if len(rows) == 1 else {"frames": rows}
        write_text(folder / "result.json", codec.dumps(document, indent=2) + "\n")
        if pilot is not None:
            (folder / pilot).unlink()
    if json:
        print_json(document)
    else:
        print(out)


def _collect(folder: Path, outputs: list[FrameOutput]) -> list[dict[str, Any]]:
    """The frames' results without metrics (nothing has been compared); their files are removed."""
    rows = []
    for output in outputs:
        row = codec.loads((folder / output.result).read_text())
        rows.append({key: value for key, value in row.items() if key not in ("metrics", "noise_floor")})
        (folder / output.result).unlink()
    return rows


def _exposure(scene: Scene, first: NDArray[np.float32]) -> float:
    """The scene's exposure; where no reference has fixed it yet, 1 / 99th percentile luminance of the first frame."""
    exposure = scene.exposure or Store().exposure(scene.hash)
    if exposure is None:
        bright = float(np.percentile(luminance(first), 99))
        exposure = 1 / bright if bright > 0 else 1.0
    return exposure


def _beauty(path: Path) -> NDArray[np.float32]:
    return read_exr(path)[0]["beauty"]
