"""A take as USD (UsdSkel): the character's meshes, skin, materials and skeleton, with a skeleton animation per take.

Converted prim by prim from the document of `runtime.formats.glb`, with joints without scales. Needs `usd-core`.
"""

import itertools
import json
import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.atomic import atomic_path, temporary_folder
from runtime.character.mesh import skin_joints
from runtime.character.nodes import Nodes
from runtime.character.read import Entry, GltfFile, open_gltf
from runtime.errors import FileError
from runtime.formats.glb import further_takes, glb_document
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.formats.table import describe
from runtime.terrain.height_map import Terrain

ROOT = "/take"
IMAGE_ENDINGS = {b"\x89PNG": ".png", b"\xff\xd8": ".jpg"}
PACKED_S = 1e9  # time stamp of every file in a package, so that equal takes give equal files


def save_usd(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> str:
    """Write a prepared take as `.usd` (one layer) or `.usdz` (textures included), and return a sentence about it.

    Raises FileError if the character cannot be used or the file cannot be written.
    """
    from pxr import Tf, UsdUtils

    with temporary_folder() as folder, atomic_path(path) as target:
        glb, layer, packed = folder / "take.glb", folder / "take.usdc", folder / "take.usdz"
        takes = [take, *further_takes(options, terrain)]
        document, _ = glb_document(takes, replace(options, plain=True), terrain, check)
        document.save(glb)
        textures = folder if path.suffix.lower() == ".usdz" else None
        try:
            stage = _Stage(open_gltf(glb), layer, takes, textures)
            stage.write()
            check()
            for part in folder.iterdir():  # a package stores the times of its files
                os.utime(part, (PACKED_S, PACKED_S))
            if textures is not None and not UsdUtils.CreateNewUsdzPackage(str(layer), str(packed)):
                raise FileError(f"{path}: the package was not written.", "Write a .usd instead.")
        except (Tf.ErrorException, np.linalg.LinAlgError) as error:
            raise FileError(f"{path}: USD refuses the take ({str(error)[:200]}).", "Write a .glb.") from error
        target.write_bytes((layer if textures is None else packed).read_bytes())
        return describe(take, path) + stage.renamed


@dataclass
class _Skin:
    """A skeleton prim: its path, and for each joint of a skin its index among all joints."""

    path: str
    inverse_bind: AnyArray
    slots: AnyArray


class _Stage:
    """The glTF document of some takes, and the USD stage made from it."""

    def __init__(self, file: GltfFile, layer: Path, takes: list[PreparedTake], textures: Path | None) -> None:
        from pxr import Gf, Sdf, Usd, UsdGeom

        self.file, self.takes, self.textures = file, takes, textures
        nodes = Nodes(file)
        self.order, self.parents, self.world = nodes.order, nodes.parents, nodes.rest
        skins, skeleton = file.gltf.skins or [], nodes.skeleton
        self.joints = [node for node in self.order if node in skeleton]  # parents first
        self.names = unique_names([self.file.gltf.nodes[node].name or "" for node in self.joints])
        self.slot = {node: k for k, node in enumerate(self.joints)}
        self.carriers = nodes.nearest(self.slot)
        self.stage = Usd.Stage.CreateNew(str(layer))
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetTimeCodesPerSecond(takes[0].clip.fps)
        self.stage.SetFramesPerSecond(takes[0].clip.fps)
        self.stage.SetStartTimeCode(0)
        self.stage.SetEndTimeCode(max(len(take.clip) for take in takes) - 1)
        self.Gf, self.Sdf = Gf, Sdf
        self.skins = [self._skin(k) for k in range(len(skins))]
        self._materials: dict[int, Any] = {}

    def _joint_paths(self) -> list[str]:
        """Return the path of each joint."""
        paths: list[str] = []
        for node, name in zip(self.joints, self.names, strict=True):
            above = self.slot.get(self.parents[node])
            paths.append(name if above is None else f"{paths[above]}/{name}")
        return paths

    @property
    def renamed(self) -> str:
        """Return a phrase that lists joints renamed because their names are duplicate or invalid in USD; "" if none were."""
        own = [self.file.gltf.nodes[node].name for node in self.joints]
        both = zip(own, self.names, strict=True)
        pairs = [f"{old[:40]} is {new[:40]}" for old, new in both if old and old != new]
        more = f" and {len(pairs) - 6} more" if len(pairs) > 6 else ""
        return f"; joints renamed: {', '.join(pairs[:6])}{more}" if pairs else ""

    def _matrices(self, matrices: AnyArray | list[Any]) -> Any:
        """Return transposed matrices, since USD uses row vectors."""
        return [self.Gf.Matrix4d(*np.asarray(m, np.float64).T.ravel().tolist()) for m in matrices]

    def _skin(self, index: int) -> _Skin:
        joints, inverse = skin_joints(self.file, index)
        slots = np.array([self.slot[node] for node in joints])
        bind = self.world[self.joints].copy()
        bind[slots] = np.linalg.inv(inverse[: len(slots)].astype(np.float64))
        return _Skin(f"{ROOT}/skeleton" + (f"_{index}" if index else ""), np.linalg.inv(bind), slots)

    def write(self) -> None:
        """Write all prims and save the layer."""
        from pxr import Usd, UsdGeom, UsdSkel, Vt

        root = UsdSkel.Root.Define(self.stage, ROOT)
        self.stage.SetDefaultPrim(root.GetPrim())
        Usd.ModelAPI(root).SetKind("component")
        local = self._local_rest()
        if not self.skins:  # motion only
            self.skins = [_Skin(f"{ROOT}/skeleton", np.linalg.inv(self.world[self.joints]), np.zeros(0, int))]
        for skin in self.skins:
            skeleton = UsdSkel.Skeleton.Define(self.stage, skin.path)
            skeleton.CreateJointsAttr(Vt.TokenArray(self._joint_paths()))
            skeleton.CreateBindTransformsAttr(self._matrices(np.linalg.inv(skin.inverse_bind)))
            skeleton.CreateRestTransformsAttr(self._matrices(local))
            UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
        if len(self.takes) == 1:
            self._bind_take(root, 0, self._animation(0, "animation"))
        else:
            self._variants(root)
        for node in self.order:
            if self.file.gltf.nodes[node].mesh is not None:
                self._meshes(node)
        # bounds of all takes, so that a viewer finds it: the joints' range plus half a body
        positions = np.concatenate([take.clip.world()[0].reshape(-1, 3) for take in self.takes])
        corners = (positions.min(axis=0) - 0.5, positions.max(axis=0) + 0.5)
        box = [self.Gf.Vec3f(*corner.tolist()) for corner in corners]
        UsdGeom.ModelAPI.Apply(root.GetPrim()).SetExtentsHint(box)
        self.stage.GetRootLayer().Save()

    def _variants(self, root: Any) -> None:
        """Add all takes, and a variant set "take" that selects which one animates the skeletons; the first is selected."""
        variants = root.GetPrim().GetVariantSets().AddVariantSet("take")
        names = unique_names([entry.name for entry in self.file.gltf.animations])
        for number, name in enumerate(names):
            animation = self._animation(number, f"animation_{name}")
            variants.AddVariant(name)
            variants.SetVariantSelection(name)
            with variants.GetVariantEditContext():
                self._bind_take(root, number, animation)
        variants.SetVariantSelection(names[0])

    def _bind_take(self, root: Any, number: int, animation: Any) -> None:
        """Bind an animation to the skeletons, with the metadata of its take."""
        from pxr import UsdSkel

        for skin in self.skins:
            binding = UsdSkel.BindingAPI(self.stage.GetPrimAtPath(skin.path))
            binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        extras = self.file.gltf.animations[number].extras["sport"]
        known = {key: json.dumps(v) if isinstance(v, list | dict) else v for key, v in extras.items()}
        root.GetPrim().SetCustomDataByKey("sport", {key: v for key, v in known.items() if v is not None})

    def _local_rest(self) -> AnyArray:
        world = self.world[self.joints]
        above = [self.slot.get(self.parents[node], -1) for node in self.joints]
        return np.stack(
            [m if p < 0 else np.linalg.inv(world[p]) @ m for m, p in zip(world, above, strict=True)]
        )

    def _animation(self, number: int, name: str) -> Any:
        """Add translations, rotations and scales of all joints, one sample per frame."""
        from pxr import Gf, UsdSkel, Vt

        entry, frames = self.file.gltf.animations[number], len(self.takes[number].clip)
        rest = self._local_rest()
        scales = np.linalg.norm(rest[:, :3, :3], axis=1)
        places = np.tile(rest[:, :3, 3], (frames, 1, 1))
        turns = np.tile(rotations.from_matrix(rest[:, :3, :3] / scales[:, None]), (frames, 1, 1))
        for channel in entry.channels:
            sampler = entry.samplers[channel.sampler]
            values, k = self.file.values(sampler.output, "a track"), self.slot[channel.target.node]
            if channel.target.path == "rotation":
                turns[:, k] = values[:, [3, 0, 1, 2]]
            elif channel.target.path == "translation":
                places[:, k] = values
        animation = UsdSkel.Animation.Define(self.stage, f"{ROOT}/{name}")
        animation.CreateJointsAttr(Vt.TokenArray(self._joint_paths()))
        translations, quaternions = animation.CreateTranslationsAttr(), animation.CreateRotationsAttr()
        animation.CreateScalesAttr([Gf.Vec3h(*row) for row in scales.tolist()])
        for frame in range(frames):
            translations.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(places[frame], np.float32)), frame)
            quaternions.Set(Vt.QuatfArray([Gf.Quatf(*row) for row in turns[frame].tolist()]), frame)
        return animation

    def _meshes(self, node: int) -> None:
        """Add the meshes of a node: skinned, attached to the joint above, or static."""
        from pxr import UsdGeom, UsdShade

        gltf = self.file.gltf
        (named,) = unique_names([gltf.nodes[node].name or f"mesh_{node}"])
        for number, primitive in enumerate(gltf.meshes[gltf.nodes[node].mesh].primitives):
            path = f"{ROOT}/{named}" + (f"_{number}" if number else "")
            if self.stage.GetPrimAtPath(path):
                path += f"_{node}"
            mesh = UsdGeom.Mesh.Define(self.stage, path)
            count = self._geometry(mesh, primitive)
            self._bind(mesh, node, primitive, count)
            index = primitive.material
            if index is not None:
                if index not in self._materials:
                    self._materials[index] = self._material(index)
                UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(self._materials[index])
                mesh.CreateDoubleSidedAttr(bool(gltf.materials[index].doubleSided))

    def _geometry(self, mesh: Any, primitive: Entry) -> int:
        """Add points, triangles, normals, texture coordinates and colours; return the number of points."""
        from pxr import UsdGeom, Vt

        points, normals, uv, colors = (
            np.ascontiguousarray(self.file.values(index, name), np.float32)
            if (index := primitive.attributes.get(name)) is not None
            else None
            for name in ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0")
        )
        assert points is not None  # the character was loaded before
        count = len(points)
        indices = np.arange(count)
        if primitive.indices is not None:
            indices = self.file.values(primitive.indices, "indices").ravel()
        triangles = np.ascontiguousarray(indices[: len(indices) // 3 * 3], np.int32)
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles) // 3, 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
        api, types = UsdGeom.PrimvarsAPI(mesh), self.Sdf.ValueTypeNames
        if normals is not None:
            mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
            mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        if uv is not None:
            flipped = np.ascontiguousarray(np.stack([uv[:, 0], 1.0 - uv[:, 1]], -1), np.float32)
            primvar = api.CreatePrimvar("st", types.TexCoord2fArray, UsdGeom.Tokens.vertex)
            primvar.Set(Vt.Vec2fArray.FromNumpy(flipped))
        if colors is not None:
            mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(
                Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(colors[:, :3]))
            )
        return count

    def _bind(self, mesh: Any, node: int, primitive: Entry, count: int) -> None:
        """Bind a mesh to its skin; a mesh on a joint follows that joint, any other is static."""
        from pxr import UsdGeom, UsdSkel

        number, carrier = self.file.gltf.nodes[node].skin, self.carriers[node]
        skin = self.skins[number or 0]
        place = np.eye(4)
        if number is not None:
            joints = self._influences(primitive, "JOINTS").astype(int)
            slots = skin.slots[np.minimum(joints, len(skin.slots) - 1)]  # clamped: these have no weight
            weights = self._influences(primitive, "WEIGHTS").astype(np.float64)
            weights /= np.maximum(weights.sum(1, keepdims=True), 1e-9)
        elif carrier >= 0:
            slots, weights = np.full((count, 1), self.slot[carrier]), np.ones((count, 1))
            bind = np.linalg.inv(skin.inverse_bind[self.slot[carrier]])
            place = bind @ np.linalg.inv(self.world[carrier]) @ self.world[node]
        else:
            if not np.allclose(self.world[node], np.eye(4)):
                UsdGeom.Xformable(mesh).AddTransformOp().Set(self._matrices([self.world[node]])[0])
            return
        binding, width = UsdSkel.BindingAPI.Apply(mesh.GetPrim()), slots.shape[1]
        binding.CreateJointIndicesPrimvar(False, width).Set(np.ascontiguousarray(slots, np.int32).ravel())
        binding.CreateJointWeightsPrimvar(False, width).Set(np.ascontiguousarray(weights, np.float32).ravel())
        binding.CreateGeomBindTransformAttr(self._matrices([place])[0])
        binding.CreateSkeletonRel().SetTargets([skin.path])

    def _influences(self, primitive: Entry, name: str) -> AnyArray:
        """Return joint indices or weights `(V, 4 or 8)` of a primitive."""
        sets = [primitive.attributes.get(f"{name}_{k}") for k in (0, 1)]
        return np.concatenate([self.file.values(k, name) for k in sets if k is not None], axis=1)

    def _material(self, index: int) -> Any:
        """Add a preview surface with base colour (a packaged texture, else vertex colours), roughness and metallic."""
        from pxr import UsdShade

        entry, types = self.file.gltf.materials[index], self.Sdf.ValueTypeNames
        surface = entry.pbrMetallicRoughness or Entry()
        path = f"{ROOT}/materials/{re.sub('[^A-Za-z0-9_]', '_', f'm{index}_' + (entry.name or ''))}"
        self.stage.DefinePrim(f"{ROOT}/materials", "Scope")
        material = UsdShade.Material.Define(self.stage, path)
        factor = tuple(float(v) for v in surface.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)))
        shader = self._shader(
            f"{path}/surface", "UsdPreviewSurface",
            roughness=(types.Float, float(surface.get("roughnessFactor", 1.0))),
            metallic=(types.Float, float(surface.get("metallicFactor", 1.0))),
            diffuseColor=(types.Color3f, factor[:3]),
        )  # fmt: skip
        color = self._color(path, index, surface.baseColorTexture, factor)
        if color is not None:
            shader.GetInput("diffuseColor").ConnectToSource(color)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        return material

    def _color(self, path: str, index: int, texture: Entry | None, factor: tuple[float, ...]) -> Any:
        """Return the output of a shader for a texture, or else for the vertex colours; None without either."""
        types = self.Sdf.ValueTypeNames
        if texture is None:
            used = [p for mesh in self.file.gltf.meshes for p in mesh.primitives if p.material == index]
            colored = all("COLOR_0" in p.attributes for p in used)
            return (
                self._primvar(f"{path}/reader", "displayColor", types.Float3, factor[:3]) if colored else None
            )
        file = self._texture(texture.index)
        if file is None:
            return None
        st = self._primvar(f"{path}/reader", "st", types.Float2)
        shader = self._shader(
            f"{path}/texture", "UsdUVTexture",
            file=(types.Asset, file), sourceColorSpace=(types.Token, "sRGB"), scale=(types.Float4, factor),
            wrapS=(types.Token, "repeat"), wrapT=(types.Token, "repeat"),
        )  # fmt: skip
        shader.CreateInput("st", types.Float2).ConnectToSource(st)
        return shader.CreateOutput("rgb", types.Float3)

    def _primvar(self, path: str, name: str, kind: Any, fallback: tuple[float, ...] | None = None) -> Any:
        """Return the output of a shader that reads a primvar of the mesh."""
        types = self.Sdf.ValueTypeNames
        reader = self._shader(path, f"UsdPrimvarReader_{kind}", varname=(types.String, name))
        output = reader.CreateOutput("result", kind)
        if fallback is not None:
            reader.CreateInput("fallback", kind).Set(fallback)
        return output

    def _shader(self, path: str, name: str, **inputs: tuple[Any, Any]) -> Any:
        """Add a shader with the type and value of each of its inputs."""
        from pxr import UsdShade

        shader = UsdShade.Shader.Define(self.stage, path)
        shader.CreateIdAttr(name)
        for field, (kind, value) in inputs.items():
            shader.CreateInput(field, kind).Set(value)
        return shader

    def _texture(self, index: int) -> str | None:
        """Return a texture's file name next to the layer; None if the format has none, or for unsupported images."""
        source = self.file.gltf.textures[index].source
        if self.textures is None or source is None:
            return None
        data = bytes(self.file.view_bytes(self.file.gltf.images[source].bufferView, "an image"))
        ending = next((end for head, end in IMAGE_ENDINGS.items() if data.startswith(head)), None)
        if ending is None:
            return None
        name = f"texture_{source}{ending}"
        (self.textures / name).write_bytes(data)
        return f"./{name}"


def unique_names(names: Sequence[str]) -> list[str]:
    """Convert names to unique USD identifiers, keeping letters of any script; some readers know joints by name alone."""
    from pxr import Sdf

    found: dict[str, None] = {}
    for number, name in enumerate(names):
        letters = unicodedata.normalize("NFC", name)
        text = "".join(c if Sdf.Path.IsValidIdentifier(f"_{c}") else "_" for c in letters)
        text = text if Sdf.Path.IsValidIdentifier(text) else f"_{text}"
        text = text if Sdf.Path.IsValidIdentifier(text) and text.strip("_") else f"joint_{number}"
        others = (f"{text}_{k}" for k in itertools.count(2))
        found[next(each for each in itertools.chain([text], others) if each not in found)] = None
    return list(found)
