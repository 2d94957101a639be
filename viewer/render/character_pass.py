"""Skinned characters: the mesh on the GPU, joint matrices in a uniform block, solid and translucent drawing."""

from dataclasses import dataclass
from typing import Any, Protocol

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError
from runtime.pose import Pose
from viewer.render.gl import JOINTS_BINDING, load_program, release, set_uniforms, upload
from viewer.render.quality import Quality

MAX_JOINTS = 256  # the block in skinning.glsl
SLOT_BYTES = MAX_JOINTS * 64
MIN_CROWD_CHARACTERS = 4  # from this many solid characters on, their meshes are simplified, as each is small
CROWD_CELL_M, CROWD_SHADOW_CELL_M = 0.016, 0.035
HEM_RINGS = 1  # of triangles around an open edge
COLORS, SAME_M = 8, 1e-4  # brightness steps, and metres, within which color and position count as equal
NEARER_M = 0.1  # a ghost this much nearer may hide the character
GHOST_TINT = (0.20, 0.45, 0.80, 0.75)  # linear colour, weight
GHOST_OPACITY = 0.7
COVERING_OPACITY = 0.35  # limit for all ghosts in front of the character together


class SkinnedMesh(Protocol):
    """Interface of a drawable mesh: a `runtime.character.character.Character`, or a stand-in with the same arrays."""

    @property
    def positions(self) -> Array: ...  # (V, 3) rest pose, metres
    @property
    def normals(self) -> Array: ...  # (V, 3)
    @property
    def colors(self) -> Array: ...  # (V, 3) linear, 0..1
    @property
    def joint_indices(self) -> NDArray[np.integer]: ...  # (V, 4)
    @property
    def joint_weights(self) -> Array: ...  # (V, 4)
    @property
    def triangles(self) -> NDArray[np.integer]: ...  # (F, 3)
    def skin_matrices(self, pose: Pose) -> Array: ...  # (K, 4, 4) rest mesh to world


@dataclass(frozen=True)
class CharacterDraw:
    pose: Pose
    opacity: float = 1.0  # less: a ghost
    matrices: Array | None = None  # of the joints, if not computed from the pose
    behind: bool = False  # a ghost that never hides solid characters

    @property
    def ghost(self) -> bool:
        return self.opacity < 1.0


class CharacterPass:
    """Draws any number of poses of one mesh."""

    def __init__(self, ctx: moderngl.Context, quality: Quality) -> None:
        self._ctx = ctx
        self._quality, self._self_shadow = quality, quality.self_shadow
        defines = {"SELF_SHADOW": int(quality.self_shadow), "SHADOW_TAPS": quality.shadow_taps}
        self._programs = {
            "surface": load_program(ctx, "character.vert", "character.frag", defines),
            "depth": load_program(ctx, "shadow_character.vert", "depth_only.frag"),
        }
        self._joints = ctx.buffer(reserve=SLOT_BYTES, dynamic=True)
        self._mesh: SkinnedMesh | None = None
        self._buffers: list[moderngl.Buffer] = []
        self._arrays: dict[str, moderngl.VertexArray] = {}
        self._content: dict[str, list[Any]] = {}  # vertex data, by program
        self._draws: list[CharacterDraw] = []

    def set_character(self, mesh: SkinnedMesh) -> None:
        """Use another mesh; FileError if it has more joints than the shaders support."""
        joints = int(mesh.joint_indices.max()) + 1
        if joints > MAX_JOINTS:
            raise FileError(
                f"The character's skin has {joints} joints, expected at most {MAX_JOINTS}.",
                "Remove helper joints from the skin and export it again.",
            )
        self._free_mesh()
        self._mesh = mesh
        floats = np.concatenate([mesh.positions, mesh.normals, mesh.colors, mesh.joint_weights], axis=1)
        vertices = self._buffer(floats, np.float32)
        joint_indices = self._buffer(mesh.joint_indices, np.uint8), "4u1", "in_joints"
        self._content = {
            "surface": [
                (vertices, "3f4 3f4 3f4 4f4", "in_position", "in_normal", "in_color", "in_weights"),
                joint_indices,
            ],
            "depth": [(vertices, "3f4 24x 4f4", "in_position", "in_weights"), joint_indices],
        }
        hems, surface, shadow = near_hems(mesh.positions, mesh.triangles), mesh.triangles, mesh.triangles
        if self._quality.cell_m:
            surface = coarse_triangles(mesh.positions, surface, self._quality.cell_m, mesh.colors, hems)
        if self._quality.shadow_cell_m:
            shadow = coarse_triangles(mesh.positions, shadow, self._quality.shadow_cell_m)
        self._add("surface", "surface", np.concatenate([surface, surface[hems[surface].any(1), ::-1]]))
        self._add("depth", "depth", shadow)

    def _add(self, name: str, program: str, triangles: NDArray[np.integer]) -> None:
        """Make the vertex array that `_render` draws by a name."""
        indices = self._buffer(triangles, np.uint32)
        self._arrays[name] = self._ctx.vertex_array(self._programs[program], self._content[program], indices)

    def _buffer(self, values: NDArray[Any], kind: type) -> moderngl.Buffer:
        self._buffers.append(self._ctx.buffer(values.astype(kind).tobytes()))
        return self._buffers[-1]

    def prepare(self, draws: list[CharacterDraw]) -> None:
        """Upload the joint matrices of all characters of the frame."""
        self._draws = draws if self._mesh is not None else []
        if self._mesh is None or not draws:
            return
        slots = np.zeros((len(draws), MAX_JOINTS, 4, 4), np.float32)
        for slot, draw in zip(slots, draws, strict=True):
            matrices = self._mesh.skin_matrices(draw.pose) if draw.matrices is None else draw.matrices
            matrices = matrices[:MAX_JOINTS]
            slot[: len(matrices)] = matrices
        upload(self._joints, slots.tobytes())

    def _render(self, name: str, slot: int) -> None:
        self._joints.bind_to_uniform_block(JOINTS_BINDING, offset=slot * SLOT_BYTES, size=SLOT_BYTES)
        self._arrays[name].render(moderngl.TRIANGLES)

    def _render_solid(self, name: str) -> None:
        solid = [slot for slot, draw in enumerate(self._draws) if not draw.ghost]
        shown = name if self._self_shadow or len(solid) < MIN_CROWD_CHARACTERS else self._crowd(name)
        for slot in solid:
            self._render(shown, slot)

    def _crowd(self, name: str) -> str:
        """Return the name of the simplified mesh that a program draws in a crowd, made at first use."""
        crowd, mesh = f"crowd {name}", self._mesh
        if crowd not in self._arrays and mesh is not None:
            cell_m, colors = (CROWD_CELL_M, mesh.colors) if name == "surface" else (CROWD_SHADOW_CELL_M, None)
            self._add(crowd, name, coarse_triangles(mesh.positions, mesh.triangles, cell_m, colors))
        return crowd

    def draw_depth(self) -> None:
        """Draw the solid characters into the bound shadow map."""
        self._render_solid("depth")

    def draw(self, shadow_map: moderngl.Texture, on_top: bool = False) -> None:
        """Draw the solid characters; `on_top` also where they are hidden."""
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._ctx.depth_func = "1" if on_top else "<"
        shadow_map.use(0)
        values = {"tint": (0.0, 0.0, 0.0, 0.0), "opacity": 1.0, "shadow_map": 0}
        set_uniforms(self._programs["surface"], values)
        self._render_solid("surface")

    def draw_ghosts(self, target: moderngl.Framebuffer) -> None:
        """Draw the translucent characters: first their depth, then only their nearest surface."""
        if not any(draw.ghost for draw in self._draws):
            return
        self._ghosts(target, behind=False)
        if any(draw.behind for draw in self._draws):
            self._bring_forward(target)
            self._ghosts(target, behind=True)

    def _ghosts(self, target: moderngl.Framebuffer, behind: bool) -> None:
        program = self._programs["surface"]
        self._ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        for slot, draw in enumerate(self._draws):
            if draw.ghost and draw.behind is behind:
                set_uniforms(program, {"tint": GHOST_TINT, "opacity": draw.opacity})
                self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
                self._ctx.depth_func = "<"
                _mask_colors(target, False)
                self._render("surface", slot)
                _mask_colors(target, True)
                self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
                self._ctx.depth_func = "<="
                self._render("surface", slot)

    def _bring_forward(self, target: moderngl.Framebuffer) -> None:
        """Keep only the solid characters' depth: later drawing hides nothing of them."""
        set_uniforms(self._programs["surface"], {"forward": 1.0})
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._ctx.depth_func = "<"
        _mask_colors(target, False)
        self._render_solid("surface")
        _mask_colors(target, True)
        set_uniforms(self._programs["surface"], {"forward": 0.0})

    def _free_mesh(self) -> None:
        parts: list[Any] = [*self._arrays.values(), *self._buffers]  # not their programs
        for item in parts:
            item.release()
        self._arrays, self._buffers = {}, []

    def release(self) -> None:
        self._free_mesh()
        release(self._joints, *self._programs.values())


def _mask_colors(target: moderngl.Framebuffer, written: bool) -> None:
    """Enable or disable color writes; a mask takes effect when its framebuffer is bound."""
    target.color_mask = written, written, written, written
    target.use()


def character_draws(
    solid: list[Pose], ghosts: list[Pose], frames: list[Pose], eye: Array
) -> list[CharacterDraw]:
    """Return the draw list: solid poses, the character first, then ghosts, then ghosts of other `frames`.

    Ghosts become fainter if several are in front of the character as seen from `eye` `(3,)`.
    """

    def away(one: Pose) -> float:
        return float(np.linalg.norm(one.hips_position - eye))

    limit = away(solid[0]) - NEARER_M if solid else 0.0
    before = sum(away(ghost) < limit for ghost in ghosts)
    each = 1.0 - (1.0 - COVERING_OPACITY) ** (1.0 / max(before, 1))
    faint = [CharacterDraw(ghost, each if away(ghost) < limit else GHOST_OPACITY) for ghost in ghosts]
    return [
        *map(CharacterDraw, solid),
        *faint,
        *(CharacterDraw(p, GHOST_OPACITY, behind=True) for p in frames),
    ]


def near_hems(positions: Array, triangles: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which vertices `(V,)` are at an open edge or a few triangles from it, where the inside of clothes is visible."""
    place = _groups(np.rint(positions / SAME_M))[1]
    corners = place[triangles]
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    first, kind = _groups(edges)
    single = edges[first][np.bincount(kind) == 1]
    hem = np.zeros(place.max(initial=0) + 1, bool)
    hem[single[single[:, 0] != single[:, 1]]] = True
    for _ in range(HEM_RINGS):
        hem[corners[hem[corners].any(1)]] = True
    return np.asarray(hem[place])


def coarse_triangles(
    positions: Array,
    triangles: NDArray[np.integer],
    cell_m: float,
    colors: Array | None = None,
    kept: NDArray[np.bool_] | None = None,
) -> NDArray[np.integer]:
    """Return triangles `(n, 3)` of a simplified mesh: vertices in a cell of size `cell_m` are merged, except those `kept`.

    With `colors` `(V, 3)`, only vertices of equal colour are merged, so that colour borders stay sharp.
    """
    keys = np.floor(positions / cell_m).astype(np.int64)
    order = np.arange(len(positions))
    if colors is not None:
        color = _groups(np.rint(colors * COLORS))[1]
        place = _groups(np.rint(positions / SAME_M))[1]
        least, most = np.full(place.max() + 1, color.max()), np.zeros(place.max() + 1, np.int64)
        np.minimum.at(least, place, color)
        np.maximum.at(most, place, color)
        keys = np.column_stack([keys, color, least[place], most[place]])
        # the first vertex of a cell has one position for all colors meeting there
        order = np.argsort(place, kind="stable")
    first, cell = _groups(keys[order])
    stands = np.empty(len(positions), np.int64)
    stands[order] = order[first][cell]
    if kept is not None:
        stands[kept] = np.flatnonzero(kept)
    coarse = stands[triangles]
    return coarse[(coarse != np.roll(coarse, 1, axis=1)).all(1)]


def _groups(rows: Array | NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the index of the first row of each kind, and the kind of every row; `np.unique` imports a package at its first call."""
    order = np.lexsort(rows.T)
    begins = np.ones(len(rows), bool)
    begins[1:] = (rows[order][1:] != rows[order][:-1]).any(1)
    kind = np.empty(len(rows), np.int64)
    kind[order] = np.cumsum(begins) - 1
    return order[begins], kind
