"""Makes small evaluation folders out of numpy images, for tests of the report."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from jobs.comparing import Comparison, ReferenceImage
from renderers.images import luminance, write_exr
from reports.folder import Cell, Evaluation, ReferenceInfo, SceneInfo
from reports.results import Result

WIDTH, HEIGHT = 32, 24
REPLICATES = 16
DEVICE = {"gl": "llvmpipe (LLVM 15.0.6, 256 bits)", "cpu": "AMD EPYC", "threads": "2", "mitsuba": "llvm_ad_rgb"}
# name, label, settings, transport, noise, bias, seconds
METHODS = [
    ("ir", "ir vpls=1024", {"vpls": 1024, "clamp": 0.1}, "one-bounce", 0.03, 0.97, 0.21),
    ("ir", "ir vpls=16384", {"vpls": 16384, "clamp": 0.1}, "one-bounce", 0.008, 0.98, 2.9),
    ("flc", "flc", {"vpls": 16384, "levels": 3}, "one-bounce", 0.012, 0.99, 0.62),
    ("rcs", "rcs", {"accuracy": 0.2}, "one-bounce", 0.0, 1.02, 1.4),
    ("pmic", "pmic", {"photons": 100000}, "full", 0.02, 0.985, 3.8),
    ("pt", "pt spp=4", {"spp": 4, "transport": "full"}, "full", 0.35, 1.0, 0.3),
    ("pt", "pt spp=16", {"spp": 16, "transport": "full"}, "full", 0.17, 1.0, 1.2),
    ("pt", "pt spp=64", {"spp": 64, "transport": "full"}, "full", 0.085, 1.0, 4.7),
]
SCENES = ["cornell-box", "cornell-glossy", "colonnade", "furnace", "living-room"]


def truth(scene: int, frame: int, transport: str, size: tuple[int, int]) -> np.ndarray:
    """A smooth picture with a dark corner and a light, linear float64 (H, W, 3)."""
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    walls = np.stack([0.75 - 0.55 * x, 0.2 + 0.3 * np.sin(3 * y + scene + 0.2 * frame) ** 2, 0.15 + 0.6 * x], -1)
    light = np.exp(-((x - 0.5) ** 2 + (y - 0.12 - 0.05 * scene) ** 2) * 24)[..., None] * 2.2
    box = np.where((abs(x - 0.35) < 0.13) & (abs(y - 0.7) < 0.2), 0.45, 1.0)[..., None]
    return (walls * (0.35 + light) * box + (0.05 if transport == "full" else 0.0)) * (0.5 + 0.3 * (1 - y))[..., None]


def make(
    folder: Path,
    scenes: int = 1,
    methods: int = 1,
    seeds: int = 1,
    frames: int = 1,
    failing: frozenset[tuple[int, int]] = frozenset(),
    size: tuple[int, int] = (WIDTH, HEIGHT),
    noise: float = 0.004,
    compared: frozenset[int] | None = None,
) -> Path:
    """Write an evaluation folder; `failing` holds (scene, method) indices whose cells failed, `compared` the frames with references
    (None: all). Returns the folder.
    """
    for name in ("results", "images", "references"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    cells, references, infos = [], [], []
    for s, scene in enumerate(SCENES[:scenes]):
        exposure = float(1 / np.percentile(luminance(truth(s, 0, "full", size)), 99))
        infos.append(
            SceneInfo(
                name=scene,
                hash=hashlib.sha256(scene.encode()).hexdigest(),
                needs=["diffuse", "area_light"],
                notes=["a light's range is ignored"] if s == 0 else [],
                triangles=36 + 1000 * s,
                exposure=exposure,
                aliasing={"rmse": 5.9, "ssim": 0.981, "over_2pct": 0.024},
            )
        )
        comparisons: dict[tuple[int, int], Comparison] = {}
        for frame in range(frames):
            stored = {}
            for transport in ("one-bounce", "full") if compared is None or frame in compared else ():
                mean = truth(s, frame, transport, size)
                variance = (noise * mean) ** 2
                mean = (mean + noise * mean * rng.standard_normal(mean.shape[:2])[..., None]).astype(np.float32)
                variance_y = ((noise * luminance(mean)) ** 2).astype(np.float32)
                key = f"{scene}-{transport}-f{frame}-centre"
                layers = {"mean": mean, "variance": variance.astype(np.float32), "luminance_variance": variance_y}
                write_exr(folder / "references" / f"{key}.exr", layers, default="mean", n=str(REPLICATES), spp="64")
                stored[transport] = layers
                references.append(
                    ReferenceInfo(
                        id=key, scene=scene, frame=frame, transport=transport, pixel="centre", noise=noise, asked=0.004,
                        replicates=REPLICATES, spp=64, seconds=12.5, content_hash=hashlib.sha256(mean.tobytes()).hexdigest(),
                    )
                )  # fmt: skip
            for m, (method, label, settings, transport, sigma, bias, seconds) in enumerate(METHODS[:methods]):
                for seed in range(seeds):
                    cell_id = f"{scene}-{m}-{method}-s{seed}-f{frame}"
                    failed = (s, m) in failing
                    cells.append(
                        Cell(
                            id=cell_id, scene=scene, method=method, label=label, settings=settings, seed=seed, frame=frame,
                            width=size[0], height=size[1], transport=transport, state="failed" if failed else "done",
                            error="UnsupportedScene: ir can't render this scene: needs <environment>" if failed else None,
                        )
                    )  # fmt: skip
                    if failed:
                        continue
                    image = truth(s, frame, transport, size) * bias
                    image = np.maximum(image * (1 + sigma * rng.standard_normal(image.shape)), 0).astype(np.float32)
                    layers, captions = {"beauty": image}, dict[str, str]()
                    if method == "ir":
                        layers["debug.light-paths"] = np.clip(image, 0, 1)
                        captions["caption.debug.light-paths"] = "where <virtual> lights lie"
                    write_exr(folder / "images" / f"{cell_id}.exr", layers, default="beauty", **captions)
                    comparison = comparisons.setdefault((m, seed), Comparison(exposure))
                    roles = {"matched": transport, "full": "full"} if stored else {}
                    own = {role: ReferenceImage(**stored[key], n=REPLICATES) for role, key in roles.items()}
                    metrics, floors = comparison.frame(frame, image, own)
                    wall = seconds * (1 + 0.05 * seed) * (1 + 0.2 * s)
                    result = Result(
                        scene=scene, scene_hash=infos[-1].hash, method=method, label=label, settings=settings,
                        settings_hash=hashlib.sha256(json.dumps(settings).encode()).hexdigest(), seed=seed, frame=frame,
                        width=size[0], height=size[1], transport=transport, metrics=metrics, noise_floor=floors, timings=[
                            {"name": "warm", "wall_s": 9.0, "cpu_s": 9.0, "gpu_s": None, "calls": 1, "stage": "prepare"},
                            {"name": "shade", "wall_s": wall, "cpu_s": 1.8 * wall, "gpu_s": None, "calls": 1, "stage": "render"},
                        ],
                        counters={"rays": 1000 * (m + 1) * size[0] * size[1] + frame}
                        | ({"vpls_lit": 900 * m} if method == "ir" else {}),
                        approximations=["glossy: diffuse at the source"] if method == "ir" else [],
                        frame_hash=hashlib.sha256(image.tobytes()).hexdigest(), peak_rss_bytes=300 << 20, device=DEVICE,
                        versions={"luxmeter": "0.1.0", "numpy": np.__version__}, started="2026-01-02T03:04:05Z",
                        finished="2026-01-02T03:04:09Z",
                    )  # fmt: skip
                    (folder / "results" / f"{cell_id}.json").write_text(result.model_dump_json(indent=1))
    evaluation = Evaluation(
        id="3f9a" * 16,
        created="2026-01-02T03:04:05Z",
        command="luxmeter evaluate --scene cornell-box --method ir --out report",
        request={"scenes": SCENES[:scenes], "methods": [m[0] for m in METHODS[:methods]], "seeds": seeds},
        scenes=infos,
        cells=cells,
        references=references,
    )
    (folder / "evaluation.json").write_text(evaluation.model_dump_json(indent=1))
    return folder
