"""Load a scene, built-in or from a file, and print what a renderer must know: 01_load_and_describe_a_scene.py [NAME|PATH]."""

from __future__ import annotations

import sys

import renderers


def main() -> None:
    name = sys.argv[1] if len(sys.argv) > 1 else "cornell-box"
    scene = renderers.load_scene(name)
    world = scene.world(frame=0)
    print(f"{scene.name}: {renderers.builtin_scenes().get(name, 'from a file')}")
    print(f"  parameters   {dict(scene.parameters) or 'none'}")
    print(f"  needs        {', '.join(sorted(scene.needs))}")
    print(
        f"  triangles    {len(world.triangles):,} in {len(scene.meshes)} meshes, placed {len(set(world.instance.tolist()))} times"
    )
    print(f"  half size    {1 / world.scale:.3f} m")
    for light in world.lights:
        print(f"  {light.kind} light, intensity {light.intensity.round(3)} (normalised scene)")
    if len(world.emissive):
        area = world.areas[world.emissive].sum() / world.scale**2
        print(f"  area light   {len(world.emissive)} emissive triangles, {area:.4f} m²")
    if scene.environment is not None:
        print(f"  environment  radiance {scene.environment.radiance}")
    if scene.channels:
        print(
            f"  animation    {len(scene.channels)} channels, {max(c.times[-1] for c in scene.channels):.1f} s at {scene.fps:g} fps"
        )
    for note in scene.notes:
        print(f"  note         {note}")
    print(f"  hash         {scene.hash}")


if __name__ == "__main__":
    main()
