"""Materials and base-colour textures (glTF 2.0, 3.9; KHR_materials_emissive_strength; KHR_texture_transform).

metallic 0 and roughness 1 is Lambert, everything else GGX; Phong and exceptions stand in extras.luxmeter. A MASK material whose
constant alpha is under its cutoff, and a BLEND material of alpha < 0.5, remove their primitives; all others are opaque.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderers.scene.gltf.accessors import Accessors
from renderers.scene.gltf.container import Document
from renderers.scene.gltf.element import Element, quoted
from renderers.scene.gltf.extras import foreign_extras, own_extras
from renderers.scene.model import BLACK, GGX, Color, Lambert, Material, Phong, SceneError, Texture
from renderers.scene.notes import Notes
from renderers.scene.world import ALPHA_MIN

MAX_TEXTURE_PIXELS = 2**26
LUMENS_PER_WATT = 683.0
# a colour times a radiance must stay within float32
MAX_RADIANCE = 1e15
MAX_EXPONENT = 1e9
MAX_TEXTURE_SHIFT = 1e6
Wrap = Literal["repeat", "clamp", "mirror"]
WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
OTHER_TEXTURES = ("normalTexture", "occlusionTexture", "emissiveTexture")


@dataclass(frozen=True)
class MaterialUse:
    """A material with what its primitives must know: whether they are removed, and the transform of their texture coordinates.

    uv_transform float64 (2, 3) applied to (u, v, 1), or None; textured tells whether texture coordinates matter at all.
    """

    material: Material
    removed: bool = False
    uv_transform: NDArray[np.float64] | None = None

    @property
    def textured(self) -> bool:
        """Whether the material has a base-colour texture."""
        return self.material.texture is not None


DEFAULT = MaterialUse(GGX("default", double_sided=False))


def read_materials(document: Document, textures: dict[int, int], notes: Notes, *, photometric: bool) -> list[MaterialUse]:
    """All materials in order; `textures` maps texture indices of the file to those of the Scene."""
    return [_material(item, textures, notes, photometric) for item in document.root.objects("materials")]


def _material(item: Element, textures: dict[int, int], notes: Notes, photometric: bool) -> MaterialUse:
    pbr = item.child("pbrMetallicRoughness")
    red, green, blue, alpha = pbr.numbers("baseColorFactor", 4, (1, 1, 1, 1), 0, 1)
    metallic, roughness = pbr.number("metallicFactor", 1.0, 0, 1), pbr.number("roughnessFactor", 1.0, 0, 1)
    texture, transform = _base_texture(pbr, textures, notes)
    for key in OTHER_TEXTURES:
        notes.add(f"{key} is ignored ({{n}} materials)", int(item.has(key)))
    notes.add("metallicRoughnessTexture is ignored ({n} materials)", int(pbr.has("metallicRoughnessTexture")))
    emission = _emission(item, 1 / LUMENS_PER_WATT if photometric else 1.0)
    name, extras, sides = item.text("name"), foreign_extras(item), item.flag("doubleSided")
    base: Color = (red, green, blue)
    own = own_extras(item)
    model = own.choice("model", ("lambert", "ggx", "phong"), "") if own is not None and own.has("model") else ""
    found: Material
    if own is not None and model == "phong":
        diffuse, specular = color(own, "diffuse"), color(own, "specular")
        found = Phong(name, diffuse, specular, own.number("exponent", low=0, high=MAX_EXPONENT), texture, emission, sides, extras)
    elif model == "lambert" or (not model and metallic == 0 and roughness == 1):
        found = Lambert(name, base, texture, emission, sides, extras)
    else:
        found = GGX(name, base, metallic, roughness, texture, emission, sides, extras)
        notes.add(f"alpha of smooth materials is raised to {ALPHA_MIN:g} ({{n}} materials)", int(roughness**2 < ALPHA_MIN))
    return MaterialUse(found, _removed(item, alpha, notes), transform)


def color(item: Element, key: str, default: Color | None = None) -> Color:
    """Three numbers in [0, MAX_RADIANCE]."""
    red, green, blue = item.numbers(key, 3, default, 0, MAX_RADIANCE)
    return red, green, blue


def _emission(item: Element, unit: float) -> Color:
    red, green, blue = item.numbers("emissiveFactor", 3, BLACK, 0, 1)
    strength = item.extension("KHR_materials_emissive_strength")
    factor = unit * (1.0 if strength is None else strength.number("emissiveStrength", 1.0, 0, MAX_RADIANCE))
    return red * factor, green * factor, blue * factor


def _removed(item: Element, alpha: float, notes: Notes) -> bool:
    mode = item.choice("alphaMode", ("OPAQUE", "MASK", "BLEND"), "OPAQUE")
    cutoff = 0.5 if mode == "BLEND" else item.number("alphaCutoff", 0.5, 0)
    if mode == "OPAQUE":
        return False
    name = quoted(item.text("name"))
    if alpha < cutoff:
        notes.add(f"material {name}: {mode} with alpha {alpha:g} < {cutoff:g}: its primitives are removed")
        return True
    notes.add(f"material {name}: {mode} with alpha {alpha:g} is opaque here (alpha of textures is ignored)")
    return False


def _base_texture(pbr: Element, textures: dict[int, int], notes: Notes) -> tuple[int | None, NDArray[np.float64] | None]:
    if not pbr.has("baseColorTexture"):
        return None, None
    info = pbr.child("baseColorTexture")
    index = info.integer("index")
    if index not in textures:
        raise info.error(f"index {index} names none of the textures")
    transform = info.extension("KHR_texture_transform")
    owner = transform if transform is not None and transform.has("texCoord") else info
    if owner.integer("texCoord", 0) != 0:
        notes.add("base-colour texture on a texture coordinate set other than 0 is ignored ({n} materials)")
        return None, None
    if transform is None:
        return textures[index], None
    notes.add("KHR_texture_transform is applied to the texture coordinates ({n} materials)")
    return textures[index], _uv_matrix(transform)


def _uv_matrix(transform: Element) -> NDArray[np.float64]:
    limits = (-MAX_TEXTURE_SHIFT, MAX_TEXTURE_SHIFT)
    (du, dv), (su, sv) = transform.numbers("offset", 2, (0, 0), *limits), transform.numbers("scale", 2, (1, 1), *limits)
    angle = transform.number("rotation", 0.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * su, s * sv, du], [-s * su, c * sv, dv]])


def base_color_textures(document: Document) -> list[int]:
    """Texture indices to decode: those of base colours and those that nothing refers to."""
    base: set[int] = set()
    other: set[int] = set()
    for item in document.root.objects("materials"):
        pbr = item.child("pbrMetallicRoughness")
        for owner, key in [(pbr, "baseColorTexture"), (pbr, "metallicRoughnessTexture"), *((item, k) for k in OTHER_TEXTURES)]:
            if owner.has(key):
                (base if key == "baseColorTexture" else other).add(owner.child(key).integer("index"))
    return [i for i in range(len(document.root.objects("textures"))) if i in base or i not in other]


def read_textures(document: Document, accessors: Accessors, notes: Notes) -> tuple[tuple[Texture, ...], dict[int, int]]:
    """Decoded textures, and where each texture of the file went."""
    items, images = document.root.objects("textures"), document.root.objects("images")
    for image in images:
        if image.has("uri"):
            # every image's URI is judged, also of those that no base colour uses
            document.uri(image)
    found: list[Texture] = []
    places: dict[int, int] = {}
    pixels = 0
    for index in base_color_textures(document):
        item = items[index]
        source = item.index("source", len(images), "images")
        if source is None:
            raise item.error("has no PNG or JPEG source")
        decoded = _decoded(document, accessors, images[source], MAX_TEXTURE_PIXELS - pixels, notes)
        pixels += decoded.shape[0] * decoded.shape[1]
        places[index] = len(found)
        name = item.text("name") or images[source].text("name")
        found.append(Texture(name, decoded, _wrap(document, item)))
    return tuple(found), places


def _wrap(document: Document, item: Element) -> tuple[Wrap, Wrap]:
    samplers = document.root.objects("samplers")
    index = item.index("sampler", len(samplers), "samplers")
    if index is None:
        return "repeat", "repeat"
    modes = [samplers[index].integer(key, 10497) for key in ("wrapS", "wrapT")]
    if any(mode not in WRAPS for mode in modes):
        raise samplers[index].error("unknown wrap mode")
    return WRAPS[modes[0]], WRAPS[modes[1]]


def _decoded(document: Document, accessors: Accessors, item: Element, budget: int, notes: Notes) -> NDArray[np.uint8]:
    from PIL import Image

    if item.has("uri"):
        data = document.uri(item)
    else:
        view = item.index("bufferView", accessors.view_count(), "buffer views")
        if view is None:
            raise item.error("has neither a URI nor a bufferView")
        data = bytes(accessors.view(view))
    try:
        with warnings.catch_warnings():
            # Pillow's own size warning comes before our limit can speak
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        if image.width * image.height > budget:
            raise item.error(f"{image.width} x {image.height} pixels: more than {MAX_TEXTURE_PIXELS} in all textures")
        notes.add("image alpha is ignored ({n} images)", int(image.mode in ("RGBA", "LA", "PA")))
        if image.mode.startswith("I"):
            grey = (np.asarray(image).astype(np.float64) / 257).round().astype(np.uint8)
            return np.repeat(grey[..., None], 3, axis=2)
        return np.array(image.convert("RGB"))
    except SceneError:
        raise
    except Exception as error:
        # Pillow answers damaged data with OSError, SyntaxError, ValueError, struct.error, zlib.error and more
        raise item.error(f"not a readable PNG or JPEG image ({type(error).__name__})") from None
