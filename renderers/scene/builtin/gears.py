"""A gear train on a plate: involute gears, shafts and bolts, every repeated part instanced."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.boxes import FPS
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.builtin.solids import box, lathe, loft, merge, swapped
from renderers.scene.model import BLACK, GGX, Lambert, Quaternion, Scene
from renderers.scene.shapes import Shape

F64 = NDArray[np.float64]
MODULE, PRESSURE_ANGLE, THICKNESS = 0.05, np.radians(20.0), 0.16
# teeth, index of the gear it meshes with, direction from that one in degrees, material
TRAIN = (
    (24, None, 0.0, "steel"),
    (40, 0, 28.0, "brass"),
    (18, 0, 165.0, "copper"),
    (32, 2, 75.0, "steel"),
    (18, 1, -62.0, "copper"),
)
METALS = {"steel": (0.56, 0.57, 0.58), "brass": (0.88, 0.69, 0.36), "copper": (0.93, 0.62, 0.52)}


@checked(steps=(1, 64))
def gears(steps: int = 6, turning: bool = False) -> Scene:
    """Train of five involute gears with shafts and bolts, rough metals on a painted plate; a CAD assembly of instanced parts.

    `steps` is the number of segments of each tooth flank (6 gives about 79,000 triangles). `turning` animates the train; 96
    frames a round.
    """
    b = SceneBuilder("gears")
    metals = {name: b.material(GGX(name, color, metallic=1.0, roughness=0.35)) for name, color in METALS.items()}
    paint = b.material(GGX("paint", (0.10, 0.16, 0.22), metallic=0.0, roughness=0.5))
    b.place(box((-1.75, -1.3, -0.25), (2.7, 2.4, -0.12), 0.5), paint, "plate")
    shaft = b.shape(_shaft(), metals["steel"], "shaft")
    bolt = b.shape(_bolt(), metals["steel"], "bolt")
    for node, centre, teeth in _train(b, metals, steps, turning):
        b.node(name="shaft", meshes=(shaft,), translation=centre)
        if teeth >= 24:
            for angle in 2 * np.pi * np.arange(6) / 6:
                where = 0.55 * MODULE * teeth / 2 * np.array([np.cos(angle), np.sin(angle)])
                b.node(
                    name="bolt", parent=node, meshes=(bolt,), translation=(float(where[0]), float(where[1]), 0.03), scale=(0.6,) * 3
                )
    rim = [(x, y) for y in (-1.15, 2.25) for x in np.linspace(-1.6, 2.55, 8)] + [
        (x, y) for x in (-1.6, 2.55) for y in np.linspace(-0.58, 1.68, 5)
    ]
    for x, y in rim:
        b.node(name="bolt", meshes=(bolt,), translation=(float(x), float(y), -0.12))
    _studio(b)
    return b.build(fps=FPS, steps=steps, turning=turning)


def _train(b: SceneBuilder, metals: dict[str, int], steps: int, turning: bool) -> list[tuple[int, tuple[float, float, float], int]]:
    """Place the gears in mesh: (node, centre, teeth) of each."""
    placed: list[tuple[int, tuple[float, float, float], int]] = []
    angles: list[float] = []
    for teeth, with_gear, degrees, metal in TRAIN:
        centre, turn, way = (0.0, 0.0, 0.0), 0.0, 1.0
        if with_gear is not None:
            _, (x, y, _), other = placed[with_gear]
            beta, reach = np.radians(degrees), MODULE * (teeth + other) / 2
            centre = (float(x + reach * np.cos(beta)), float(y + reach * np.sin(beta)), 0.0)
            # a tooth of the one points into a gap of the other
            turn = beta + np.pi + np.pi / teeth - (angles[with_gear] - beta) * other / teeth
            way = -float(np.sign(_speed(with_gear)))
        mesh = b.shape(_gear(teeth, steps), metals[metal], f"gear {teeth}")
        node = b.node(name=f"gear {teeth}", meshes=(mesh,), translation=centre, rotation=_about_z(turn))
        if turning:
            frame = np.arange(97)
            spin = turn + way * 2 * np.pi * TRAIN[0][0] / teeth * frame / 96
            b.animate(node, "rotation", frame / FPS, [_about_z(float(a)) for a in spin])
        placed.append((node, centre, teeth))
        angles.append(turn)
    return placed


def _speed(gear: int) -> float:
    """Angular speed of a gear for a driver of speed 1: each contact turns the sense round."""
    teeth, other, _, _ = TRAIN[gear]
    return 1.0 if other is None else -_speed(other) * TRAIN[other][0] / teeth


def _about_z(angle: float) -> Quaternion:
    return 0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2))


def outline(teeth: int, steps: int) -> F64:
    """Spur-gear outline (P, 2), counter-clockwise, a tooth at angle 0: involute flanks at 20°, fillets below the base circle.

    A flank at radius ρ lies half a tooth = π/(2N) + inv α - inv(acos(r_b/ρ)) from the tooth's axis, inv φ = tan φ - φ; 3 %
    backlash. The fillet and a slight taper make the angle strictly monotone, so that no face triangle has zero area.
    """
    pitch = MODULE * teeth / 2
    base, root, tip = pitch * np.cos(PRESSURE_ANGLE), pitch - 1.25 * MODULE, pitch + MODULE
    radii = np.linspace(root, tip, steps + 1)
    phi = np.arccos(np.minimum(base / np.maximum(radii, base), 1.0))
    half = 0.97 * np.pi / (2 * teeth) + (np.tan(PRESSURE_ANGLE) - PRESSURE_ANGLE) - (np.tan(phi) - phi)
    half += 0.1 * np.maximum(base - radii, 0) / base + 0.005 * (tip - radii) / pitch
    top, bottom = np.linspace(-1, 1, 4)[1:-1], np.linspace(0, 1, 4)[1:-1]
    gap = 2 * np.pi / teeth - 2 * half[0]
    angle = np.concatenate([-half, top * half[-1], half[::-1], half[0] + bottom * gap])
    radius = np.concatenate([radii, [tip, tip], radii[::-1], [root, root]])
    every = (2 * np.pi / teeth * np.arange(teeth)[:, None] + angle).ravel()
    return np.asarray(np.column_stack([np.cos(every), np.sin(every)]) * np.tile(radius, teeth)[:, None])


def _gear(teeth: int, steps: int) -> Shape:
    """Rim with teeth, thin web, hub with a bore."""
    teeth_ring = outline(teeth, steps)
    unit = teeth_ring / np.linalg.norm(teeth_ring, axis=1, keepdims=True)
    root = MODULE * (teeth / 2 - 1.25)
    rim, hub, bore = 0.82 * root, max(0.3 * root, 0.11), 0.07
    t, w, h = THICKNESS / 2, THICKNESS / 5, THICKNESS * 0.75
    section: list[tuple[ArrayLike, float]] = [
        (teeth_ring, -t), (teeth_ring, t), (unit * rim, t), (unit * rim, w), (unit * hub, w), (unit * hub, h), (unit * bore, h),
        (unit * bore, -t), (unit * rim, -t), (teeth_ring, -t),
    ]  # fmt: skip
    return loft([np.column_stack([ring, np.full(len(teeth_ring), z)]) for ring, z in section])


def _shaft() -> Shape:
    """Shaft with a rounded end that stands out of the hub, along Z."""
    bend = np.linspace(0, 0.45 * np.pi, 12)
    end = np.column_stack([0.02 + 0.05 * np.cos(bend), 0.22 + 0.05 * np.sin(bend)])
    profile = np.vstack([[(0.07, -0.13)], end, [(0.002, 0.27)]])
    return swapped(lathe(profile, 48), "z")


def _bolt() -> Shape:
    """Hexagon head on a washer, along +Z from z = 0."""
    washer = merge(lathe([(0.065, 0.0), (0.065, 0.012)], 48), lathe([(0.065, 0.012), (0.02, 0.012)], 48))
    corner = 2 * np.pi * np.arange(60) / 60
    radius = 0.046 / np.cos((corner % (np.pi / 3)) - np.pi / 6)
    ring = np.column_stack([np.cos(corner), np.sin(corner)])
    levels = [
        (radius, 0.012),
        (radius, 0.044),
        (np.minimum(radius, 0.047), 0.05),
        (0.03 + 0 * radius, 0.05),
        (0.003 + 0 * radius, 0.05),
    ]
    head = loft([np.column_stack([ring * r[:, None], np.full(60, z)]) for r, z in levels])
    return merge(swapped(washer, "z"), head)


def _studio(b: SceneBuilder) -> None:
    white = b.material(Lambert("studio", (0.6, 0.6, 0.6)))
    warm, cool = b.material(Lambert("warm wall", (0.6, 0.45, 0.3))), b.material(Lambert("cool wall", (0.3, 0.42, 0.6)))
    open_room(b, (-3.2, -1.3, -1.2), (3.9, 3.4, 4.5), white=white, left=warm, right=cool)
    lamp = b.material(Lambert("softbox", albedo=BLACK, emission=(9.0, 8.6, 8.0), double_sided=False))
    b.quad([(-1.4, 3.35, 0.8), (1.0, 3.35, 0.8), (1.0, 3.35, 2.8), (-1.4, 3.35, 2.8)], lamp, "softbox")
    b.camera((-0.6, 1.4, 5.3), (0.48, 0.6, 0.0), np.radians(43))
