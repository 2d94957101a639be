"""Blender add-on of the SPORT viewer: imports takes and follows the running viewer live. One file, for Blender 4.2 to 5.

Install: Edit > Preferences > Add-ons > Install from Disk. Then File > Import > SPORT take, and the tab SPORT in the
sidebar of the 3D view. Without Blender, `python sport_viewer.py [HOST:PORT] [SECONDS]` counts the poses that arrive.

Messages of the live link: UDP, one per datagram, little-endian. Position and rotations are the displayed pose, after foot
lock and leg IK: metres, right-handed, Y up, +Z forward, +X left.

    header      magic 4 bytes SPRT; version u8, 1; kind u8, 1 skeleton or 2 pose; joints u16, 31
                sequence u32: poses sent before this message, modulo 2^32; gaps are losses
                skeleton u32: CRC-32 of the skeleton message after its header
    skeleton    at the start and once per second. Each joint: parent i16 (-1 at the root), offset from the parent 3 f32, length of
                the name u8, name in UTF-8. Parents come before children; rest rotations are the identity
    pose        60 per second: seconds of motion since the link was enabled f64, position of the root joint 3 f32, and
                for each joint its rotation relative to the parent 4 f32 (w, x, y, z): 532 bytes for 31 joints
"""

import contextlib
import json
import math
import os
import re
import socket
import struct
import sys
import time
from pathlib import Path
from typing import ClassVar, NamedTuple

try:
    import bpy
    from bpy_extras.io_utils import ImportHelper
    from mathutils import Matrix, Quaternion, Vector
except ModuleNotFoundError:  # used as a receiver without Blender
    bpy = None

bl_info = {
    "name": "SPORT viewer",
    "author": "SPORT viewer contributors",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "File > Import > SPORT take; 3D view > Sidebar > SPORT",
    "description": "Imports takes with prompts and ground, and follows the running viewer live",
    "category": "Animation",
}

# --- the message: little-endian, see above

VERSION = 1
SKELETON, POSE = 1, 2
DEFAULT_ADDRESS = ("127.0.0.1", 9763)
HEADER = struct.Struct("<4sBBHII")  # magic, version, kind, joints, sequence, skeleton
ROOT = struct.Struct("<d3f")  # seconds, position of the uppermost joint
JOINT = struct.Struct("<h3fB")  # parent, offset, bytes of the name
MAX_JOINTS = 1024
MAX_DATAGRAMS = 512  # limit per call: eight seconds of poses


class MessageError(Exception):
    """A datagram that is not a message of this version; it is ignored."""


class LiveSkeleton(NamedTuple):
    """Joint names, parents (-1 at the root) and offsets from the parent in metres, Y up; rest rotations are the identity."""

    number: int
    names: tuple
    parents: tuple
    offsets: tuple


class LivePose(NamedTuple):
    """A pose: position of the root joint in metres, and a parent-relative quaternion w, x, y, z for each joint."""

    sequence: int
    skeleton: int
    seconds: float
    position: tuple
    rotations: tuple


def decode(data):
    """Decode a datagram to a `LiveSkeleton` or `LivePose`; MessageError describes the problem."""
    if len(data) < HEADER.size or data[:4] != b"SPRT":
        raise MessageError("not a message of the SPORT viewer")
    _, version, kind, joints, sequence, skeleton = HEADER.unpack_from(data)
    if version != VERSION:
        raise MessageError(f"message version {version}; this add-on reads version {VERSION}")
    if kind not in (SKELETON, POSE) or not 1 <= joints <= MAX_JOINTS:
        raise MessageError("unknown kind of message")
    try:
        if kind == POSE:
            return _decode_pose(data, joints, sequence, skeleton)
        return _decode_skeleton(data, joints, skeleton)
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f"damaged message ({error})") from error


def _decode_pose(data, joints, sequence, skeleton):
    if len(data) != HEADER.size + ROOT.size + 16 * joints:
        raise MessageError("damaged message (length)")
    seconds, *position = ROOT.unpack_from(data, HEADER.size)
    flat = struct.unpack_from(f"<{4 * joints}f", data, HEADER.size + ROOT.size)
    if not all(map(math.isfinite, (seconds, *position, *flat))):
        raise MessageError("damaged message (values that are not numbers)")
    return LivePose(sequence, skeleton, seconds, tuple(position), tuple(zip(*[iter(flat)] * 4, strict=True)))


def _decode_skeleton(data, joints, number):
    names, parents, offsets, at = [], [], [], HEADER.size
    for joint in range(joints):
        parent, x, y, z, length = JOINT.unpack_from(data, at)
        at += JOINT.size
        name = data[at : at + length].decode("utf-8")
        at += length
        if not -1 <= parent < joint or not name or not all(map(math.isfinite, (x, y, z))):
            raise MessageError("damaged message (joint)")
        names.append(name)
        parents.append(parent)
        offsets.append((x, y, z))
    if at != len(data):
        raise MessageError("damaged message (length)")
    return LiveSkeleton(number, tuple(names), tuple(parents), tuple(offsets))


class Receiver:
    """A non-blocking UDP socket: `drain` returns the poses received since the last call, oldest first.

    `skeleton` is the latest one announced, `received` and `lost` count poses, `problem` is the last rejection.
    """

    def __init__(self, host=DEFAULT_ADDRESS[0], port=DEFAULT_ADDRESS[1]):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            self.socket.bind((host, port))
            self.socket.setblocking(False)
        except OSError:
            self.socket.close()
            raise
        self.address = self.socket.getsockname()[:2]
        self.skeleton, self.problem = None, ""
        self.received = self.lost = self.refused = 0
        self._sender, self._next = None, None

    def drain(self):
        """Return received poses of the announced skeleton, oldest first; earlier ones are only counted."""
        poses = []
        for _ in range(MAX_DATAGRAMS):  # the rest waits for the next call: a flood must not block Blender
            try:
                data, sender = self.socket.recvfrom(65535)
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionResetError:  # Windows: no program listens at the address this socket sent to
                continue
            try:
                message = decode(data)
            except MessageError as error:
                self.refused, self.problem = self.refused + 1, str(error)
                continue
            if isinstance(message, LiveSkeleton):
                self.skeleton = message
            elif self._count(message, sender) and self._fits(message):
                poses.append(message)
        return poses

    def _count(self, pose, sender):
        """Count gaps in the sequence; returns False for a pose that is older than the last one."""
        ahead = 0 if self._next is None else (pose.sequence - self._next) % (1 << 32)
        if sender != self._sender:  # another viewer, or the same one restarted
            self._sender, ahead = sender, 0
        elif ahead >= 1 << 31:  # a late pose, which was counted as lost
            self.received, self.lost = self.received + 1, max(self.lost - 1, 0)
            return False
        self.received, self.lost = self.received + 1, self.lost + ahead
        self._next = (pose.sequence + 1) % (1 << 32)
        return True

    def _fits(self, pose):
        known = self.skeleton
        return known and (known.number, len(known.names)) == (pose.skeleton, len(pose.rotations))

    @property
    def lost_share(self):
        """Lost fraction of the sent poses, 0 to 1."""
        return self.lost / max(self.received + self.lost, 1)

    def close(self):
        """Release the port."""
        self.socket.close()


def parse_address(text):
    """Return host and port of "127.0.0.1:9763", "[::1]:9763", "9763" or ""; ValueError."""
    host, colon, port = text.rpartition(":")
    if not colon and not text.isdigit():
        host, port = text, str(DEFAULT_ADDRESS[1])
    number = int(port or DEFAULT_ADDRESS[1])
    if not 0 <= number < 65536:
        raise ValueError(f"port {number}")
    return host.strip("[]") or DEFAULT_ADDRESS[0], number


# --- contents of files


MAX_FPS = 32767  # Blender's limits of a scene
MAX_FRAME = 1048574


class NotATakeError(ValueError):
    """A file that is not a take; its message is a sentence for the user."""


class TakeFacts(NamedTuple):
    """Data of a take's files: rate, frames, markers `(name, frame)`, metres per unit, ground, and whether it moves."""

    fps: float
    frames: int
    markers: tuple
    scale: float
    terrain: str
    placed: bool


def read_take(path):
    """Read the data of a BVH with its JSON, or of a GLB with its `extras`; ValueError describes the problem."""
    path = Path(path)
    try:
        facts = _read_glb(path) if path.suffix.lower() == ".glb" else _read_bvh(path)
    except NotATakeError:
        raise
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise NotATakeError(f"{path.name}: damaged. Export the take again.") from error
    whole = 0.0 < facts.fps <= MAX_FPS and 0 < facts.frames <= MAX_FRAME and facts.scale > 0.0
    if not whole or not all(0 <= frame <= MAX_FRAME for _, frame in facts.markers):
        raise NotATakeError(
            f"{path.name}: a rate, length or marker that Blender has no room for. Export the take again."
        )
    return facts


def _read_bvh(path):
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read()
    frames, step = re.search(r"Frames:\s*(\d+)", text), re.search(r"Frame Time:\s*([\d.eE+-]+)", text)
    if not text.lstrip().startswith("HIERARCHY") or not frames or not step or not float(step[1]) > 0.0:
        raise NotATakeError(f"{path.name}: not a BVH")
    fps = round(1.0 / float(step[1]), 3)
    offsets = re.findall(r"OFFSET\s+(\S+)\s+(\S+)\s+(\S+)", text)
    longest = max((math.hypot(*map(float, offset)) for offset in offsets[1:]), default=0.0)
    described = {}
    with contextlib.suppress(OSError, ValueError):  # a BVH from other programs has no JSON next to it
        described = json.loads(path.with_name(path.name + ".json").read_text(encoding="utf-8"))
    described = described if isinstance(described, dict) and described.get("format") == "sport-take" else {}
    found = tuple(sorted(_marks(described, fps), key=lambda mark: mark[1]))
    scale = 0.01 if longest > 3.0 else 1.0  # no bone is three metres long
    placed = described.get("placed", True) is not None
    return TakeFacts(fps, int(frames[1]), found, scale, str(described.get("terrain", "")), placed)


def _marks(described, fps):
    """Return name and frame of each prompt and gait in the JSON next to a BVH."""
    marks = [(_title(e), max(float(e.get("seconds", 0.0)), 0.0)) for e in described.get("prompts", [])]
    marks += [(str(name), float(seconds)) for seconds, name in described.get("gaits", [])]
    return [(name, round(seconds * fps)) for name, seconds in marks]


def _title(event):
    """Return the words of a prompt; if parts were edited, the typed text."""
    text = str(event.get("prompt", ""))
    with contextlib.suppress(ValueError):
        value = json.loads(text)
        if isinstance(value, dict):
            pair = [value.get(side) for side in "ab"]
            text = " + ".join(w if isinstance(w, str) else "own words" for w in pair if w) or "own words"
    return f"{event['typed']} (edited)" if event.get("typed") else text


def glb_json(path):
    """Return the JSON chunk of a GLB; ValueError."""
    with open(path, "rb") as file:
        magic, _, _, length, kind = struct.unpack("<4sIIII", file.read(20).ljust(20, b"\0"))
        if magic != b"glTF" or kind != 0x4E4F534A:
            raise NotATakeError(f"{Path(path).name}: not a GLB")
        return json.loads(file.read(length))


def _read_glb(path):
    document = glb_json(path)
    described = [a.get("extras", {}).get("sport") for a in document.get("animations", [])]
    described = next((value for value in described if value), None)
    if described is None:
        raise NotATakeError(f"{path.name}: no take of the SPORT viewer; use File > Import > glTF 2.0")
    marks = tuple((str(m["name"]), int(m["frame"])) for m in described["markers"])
    return TakeFacts(
        float(described["fps"]), int(described["frames"]), marks, 1.0, str(described.get("ground", "")), True
    )


def find_ground(path, terrain=""):
    """Find the OBJ or GLB of the ground next to a take, named NAME-ground, NAME_ground, ground, or as the terrain."""
    path = Path(path)
    stems = [f"{path.stem}-ground", f"{path.stem}_ground", "ground", Path(terrain).stem]
    for stem in filter(None, stems):
        for suffix in (".obj", ".glb"):
            found = path.with_name(stem + suffix)
            if found != path and os.path.isfile(found):  # False for an impossible name
                return found
    return None


# --- Blender: the take


def to_blender(vector):
    """Convert a point of the viewer (Y up, +Z forward) to Blender's axes (Z up, -Y forward)."""
    x, y, z = vector
    return Vector((x, -z, y))


def import_take(context, path, ground="", first_frame=1):
    """Import a take with its markers and ground, and set the scene's rate and range; returns the armature. ValueError."""
    path, facts, scene = Path(path), read_take(path), context.scene
    scene.render.fps, scene.render.fps_base = max(1, math.ceil(facts.fps - 1e-6)), 1.0
    before, actions = set(bpy.data.objects), set(bpy.data.actions)
    if path.suffix.lower() == ".glb":
        _import_with(bpy.ops.import_scene.gltf, path, bone_heuristic="BLENDER", disable_bone_shape=True)
        for action in set(bpy.data.actions) - actions:
            _retime(action, facts.fps / scene.render.fps, first_frame)
    else:
        _import_with(
            bpy.ops.import_anim.bvh, path, global_scale=facts.scale, frame_start=first_frame, use_fps_scale=False,
            rotate_mode="QUATERNION", axis_forward="-Z", axis_up="Y",
        )  # fmt: skip
    # after the import: versions of the importers treat fps_base differently
    scene.render.fps_base = scene.render.fps / facts.fps
    made = set(bpy.data.objects) - before
    armature = next((thing for thing in made if thing.type == "ARMATURE"), None)
    if armature is None:
        raise ValueError(f"{path.name}: no skeleton in it")
    scene.frame_start, scene.frame_end = first_frame, first_frame + facts.frames - 1
    _add_markers(scene, [(name[:63], frame + first_frame) for name, frame in facts.markers])
    if not any(thing.name.startswith("Ground") for thing in made):
        _import_ground(path, facts, ground)
    context.view_layer.objects.active = armature
    scene.frame_set(first_frame)
    return armature


def _import_with(importer, path, **options):
    """Read a file with Blender's own importer; ValueError in place of its exceptions."""
    try:
        importer(filepath=str(path), **options)
    except RuntimeError as error:
        raise ValueError(f"{path.name}: damaged; Blender's importer cannot read it") from error


def _add_markers(scene, marks):
    known = {(mark.name, mark.frame) for mark in scene.timeline_markers}
    for name, frame in marks:
        if (name, frame) not in known:
            scene.timeline_markers.new(name, frame=frame)


def _import_ground(path, facts, chosen):
    """Import the chosen ground, or that next to the take; none for a take in place."""
    found = Path(chosen) if chosen else (find_ground(path, facts.terrain) if facts.placed else None)
    if found is None:
        return
    if not found.is_file():
        raise ValueError(f"{found}: no such file")
    before, scale = set(bpy.data.objects), facts.scale
    if found.suffix.lower() == ".obj":
        with found.open(encoding="utf-8", errors="replace") as file:
            unit = re.search(r", (cm|m), Y up", file.readline())  # written in our own files
        scale = {"cm": 0.01, "m": 1.0}[unit[1]] if unit else scale
        _import_with(bpy.ops.wm.obj_import, found, global_scale=scale, forward_axis="NEGATIVE_Z", up_axis="Y")
    else:
        _import_with(bpy.ops.import_scene.gltf, found)
        for thing in set(bpy.data.objects) - before:
            if thing.parent is None:
                thing.scale, thing.location = thing.scale * scale, thing.location * scale


def _curves(action):
    """Return the F-curves of an action, with or without action slots."""
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [c for layer in action.layers for s in layer.strips for bag in s.channelbags for c in bag.fcurves]


def _retime(action, scale, first_frame):
    """Scale the times of all keys and move the first one to `first_frame`; all are rounded to whole frames."""
    begin = action.frame_range[0]
    for curve in _curves(action):
        values = [0.0] * (2 * len(curve.keyframe_points))
        curve.keyframe_points.foreach_get("co", values)
        values[::2] = [first_frame + round((time - begin) * scale) for time in values[::2]]
        curve.keyframe_points.foreach_set("co", values)
        curve.update()


# --- Blender: the live link


def rest_heads(skeleton):
    """Return the rest positions of the announced joints, the root at the origin."""
    heads = []
    for joint, parent in enumerate(skeleton.parents):
        heads.append(heads[parent] + to_blender(skeleton.offsets[joint]) if parent >= 0 else Vector())
    return heads


def build_armature(context, skeleton, name="SPORT live"):
    """Return an armature with the announced joints in their rest pose."""
    data = bpy.data.armatures.new(name)
    thing = bpy.data.objects.new(name, data)
    context.scene.collection.objects.link(thing)
    context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    heads, bones = rest_heads(skeleton), []
    for joint, parent in enumerate(skeleton.parents):
        bone = data.edit_bones.new(skeleton.names[joint])
        bone.head, bone.parent = heads[joint], bones[parent] if parent >= 0 else None
        bones.append(bone)
    for joint, bone in enumerate(bones):  # towards the child, because Blender removes bones without length
        below = [heads[c] for c, p in enumerate(skeleton.parents) if p == joint]
        ends = [head for head in below if (head - heads[joint]).length > 0.01]
        bone.tail = ends[0] if ends else heads[joint] + Vector((0.0, 0.0, 0.05))
    bpy.ops.object.mode_set(mode="OBJECT")
    return thing


# The viewer's joints, and their names in other rigs, reduced to lower-case letters and digits: {s} is left, {i} is l.
JOINTS = [
    "Hips", "LowerBack", "Spine", "Spine1", "Neck1", "Head", "{S}Shoulder", "{S}Arm", "{S}ForeArm", "{S}Hand",
    "{S}HandIndex1", "{S}UpLeg", "{S}Leg", "{S}Foot", "{S}ToeBase",
]  # fmt: skip
_HUMANOID = (
    "hips spine chest upperchest neck head {s}shoulder {s}upperarm {s}lowerarm {s}hand {s}middleproximal "
    "{s}upperleg {s}lowerleg {s}foot {s}toes"
)
_SMPL = (
    "pelvis spine1 spine2 spine3 neck head {s}collar {s}shoulder {s}elbow {s}wrist {s}middle1 {s}hip {s}knee "
    "{s}ankle {s}foot"
)
CONVENTIONS = (
    # Mixamo, VRM, VRoid, Unreal, SMPL, its short form, Rigify, CMU, Unity, DAZ
    "hips spine spine1 spine2 neck head {s}shoulder {s}arm {s}forearm {s}hand {s}handmiddle1 {s}upleg {s}leg {s}foot {s}toebase",
    _HUMANOID,
    " ".join(f"jbip{'' if '{' in name else 'c'}{name.replace('{s}', '{i}')}" for name in _HUMANOID.split()),
    "pelvis spine01 spine02 spine03 neck01 head clavicle{i} upperarm{i} lowerarm{i} hand{i} middle01{i} thigh{i} calf{i} foot{i} ball{i}",
    _SMPL,
    _SMPL.replace("{s}", "{i}"),
    "spine spine001 spine002 spine003 spine004 spine006 shoulder{i} upperarm{i} forearm{i} hand{i} fmiddle01{i} thigh{i} shin{i} foot{i} toe{i}",
    "root lowerback upperback thorax upperneck head {i}clavicle {i}humerus {i}radius {i}hand {i}fingers {i}femur {i}tibia {i}foot {i}toes",
    " ".join(name.replace("{s}", "") + "{i}" * ("{s}" in name) for name in _HUMANOID.split()),
    "hip abdomen - chest neck head {i}collar {i}shldr {i}forearm {i}hand {i}mid1 {i}thigh {i}shin {i}foot {i}toe",
)
SIDES = ("Left", "Right")
NEEDED = ["Hips", "Head", *(s + b for s in SIDES for b in ("UpLeg", "Leg", "Foot", "Arm", "ForeArm"))]
AIMS = dict(Arm="ForeArm", ForeArm="Hand", Hand="HandIndex1", UpLeg="Leg", Leg="Foot", Foot="ToeBase")
ANKLE_M = 0.066  # height at which the viewer's skeleton stands


def guess_joints(names):
    """Guess a rig's bones for the viewer's joints, by the naming convention that matches most; {} if none does."""
    starts = [name[: cut.end()] for name in names for cut in re.finditer(r"[-_:|. ]", name)]
    prefix = max((p for p in set(starts) if starts.count(p) > 0.6 * len(names)), key=len, default="")
    best = {}
    for strip in ("", prefix):  # the first of equal names is used
        index = {_simple_name(name.removeprefix(strip)): name for name in reversed(names)}
        found = [best, *(_named_joints(convention, index) for convention in CONVENTIONS)]
        best = max(found, key=lambda joints: len(joints.keys() & set(NEEDED)))
    return best


def check_joints(name, found):
    """Check that a rig has all required bones; ValueError names the missing ones."""
    missing = [joint for joint in NEEDED if joint not in found]
    if missing:
        raise ValueError(f"{name}: no bone found for {', '.join(missing)}; rename them as in Mixamo")


def _simple_name(name):
    """Return a bone's name without namespace, case and punctuation."""
    bare = re.sub(r"^(DEF|ORG)[-_]", "", re.split(r"[:|]", name)[-1])
    return re.sub(r"^mixamorig\d*|[^a-z0-9]", "", bare.lower())


def _named_joints(convention, index):
    """Return the bones of `index` (by simple name) that match a convention."""
    called = {
        joint.format(S=side): name.format(s=side.lower(), i=side[:1].lower())
        for joint, name in zip(JOINTS, convention.split(), strict=True)
        for side in (SIDES if "{S}" in joint else ("",))
    }
    return {joint: index[name] for joint, name in called.items() if name in index}


class Retarget:
    """Retargets poses of the viewer to a rig with other names, axes, proportions and rest pose.

    Limbs are rotated to the viewer's rest directions first, so that an A-pose works; the rig keeps its own size. The bones
    `found` include all of `NEEDED`.
    """

    def __init__(self, armature, skeleton, found):
        self.skeleton, bones = skeleton, armature.pose.bones
        self.joint = {name: skeleton.names.index(name) for name in found if name in skeleton.names}
        self.bone = {found[name]: name for name in self.joint}
        self.order = [(bone, _rest(bone), _rest(bone.parent)) for bone in bones]
        place = {name: _rest(bones[found[name]]).to_translation() for name in self.joint}
        self.facing, heads = _axes(place), rest_heads(skeleton)
        place = {name: self.facing @ head for name, head in place.items()}
        self.ours = {name: heads[joint] for name, joint in self.joint.items()}
        self.scale = _leg(place) / _leg(self.ours)
        self.turns = {name: self._turn(name, place) for name in self.joint}
        self.hips = place["Hips"] - 0.5 * (place["LeftUpLeg"] + place["RightUpLeg"])
        ankle = min(place["LeftFoot"].z, place["RightFoot"].z)
        self.lift = ankle - ANKLE_M * self.scale if abs(ankle) < 0.3 * _leg(place) else 0.0

    def _turn(self, name, place):
        """Return the rotation of a bone from its rest direction to that of the viewer's skeleton."""
        side, bone = re.findall("(Left|Right|)(.+)", name)[0]
        aim = side + AIMS.get(bone, "")
        if bone == "ToeBase":
            return self._turn(side + "Foot", place)
        if bone == "Hand" and aim not in place:
            return self._turn(side + "ForeArm", place)
        if not side or not {name, aim} <= place.keys():
            return Quaternion()
        theirs, wanted = place[aim] - place[name], self.ours[aim] - self.ours[name]
        if bone == "Foot":
            theirs.z = wanted.z = 0.0
        return theirs.rotation_difference(wanted) if theirs.length and wanted.length else Quaternion()

    def channels(self, pose):
        """Return pose bones with rotation, and location at the hips."""
        turns, at = [], []
        for joint, parent in enumerate(self.skeleton.parents):
            w, x, y, z = pose.rotations[joint]
            turn = Quaternion((w, x, -z, y))
            if parent < 0:
                turns.append(turn)
                at.append(to_blender(pose.position))
            else:
                turns.append(turns[parent] @ turn)
                at.append(at[parent] + turns[parent] @ to_blender(self.skeleton.offsets[joint]))
        back = self.facing.inverted()
        posed = {}
        for bone, rest, above in self.order:
            local = rest if above is None else above.inverted() @ rest
            held = local if above is None else posed[bone.parent.name] @ local
            name = self.bone.get(bone.name)
            if name is None:
                posed[bone.name] = held
                continue
            turn = turns[self.joint[name]] @ self.turns[name] @ (self.facing @ rest.to_quaternion())
            wanted = (back @ turn).to_matrix().to_4x4()
            wanted.translation = held.translation
            if name == "Hips":
                middle = 0.5 * (at[self.joint["LeftUpLeg"]] + at[self.joint["RightUpLeg"]])
                hips = (
                    self.scale * middle + turns[self.joint[name]] @ self.hips + Vector((0.0, 0.0, self.lift))
                )
                wanted.translation = back @ hips
            posed[bone.name] = wanted
            basis = held.inverted() @ wanted
            yield bone, basis.to_quaternion(), basis.to_translation() if name == "Hips" else None


def _rest(bone):
    """Return the rest matrix of a pose bone, None without a bone."""
    return bone and bone.bone.matrix_local


def _leg(place):
    return sum(
        (place[a] - place[b]).length
        for side in SIDES
        for a, b in ((f"{side}UpLeg", f"{side}Leg"), (f"{side}Leg", f"{side}Foot"))
    )


def _axes(place):
    """Return the quarter turns that bring a rig's left to +X and its head to +Z, as a quaternion."""
    rows = []
    for direction in (place["LeftUpLeg"] - place["RightUpLeg"], place["Head"] - place["Hips"]):
        axis = max(range(3), key=lambda k: abs(direction[k]))
        rows.append(Vector([math.copysign(1.0, direction[axis]) if k == axis else 0.0 for k in range(3)]))
    left, up = rows
    if abs(left.dot(up)) > 0.5:
        raise ValueError("the rig does not stand upright at rest")
    return Matrix((left, up.cross(left), up)).to_quaternion()


class LiveLink:
    """Applies the poses of a `Receiver` to an armature, and stores them while recording."""

    def __init__(self, context, host, port, armature=None):
        self.receiver = Receiver(host, port)
        self.name = armature.name if armature else ""
        self.recording, self.recorded = False, []
        self._bones, self._number, self._retarget = [], None, None
        self._context = context

    def step(self):
        """Read received poses and show the newest; returns their number."""
        poses = self.receiver.drain()
        if poses:
            if self.recording:
                self.recorded += poses
            self._bind(self.receiver.skeleton)
            for bone, rotation, location in self._channels(poses[-1]):
                bone.rotation_quaternion = rotation
                if location is not None:
                    bone.location = location
        return len(poses)

    @property
    def armature(self):
        """The animated armature, None before the first pose or after its deletion."""
        return bpy.data.objects.get(self.name)

    def _bind(self, skeleton):
        """Find the bones by name; creates an armature if there is none."""
        if self.armature is not None and self._number == skeleton.number:
            return
        if self.armature is None:
            self.name = build_armature(self._context, skeleton).name
        bones, self._bones, self._retarget = self.armature.pose.bones, [], None
        for joint, name in enumerate(skeleton.names):
            bone = bones.get(name)
            if bone is not None:
                bone.rotation_mode = "QUATERNION"
                rest = bone.bone.matrix_local
                head = rest.to_translation() if skeleton.parents[joint] < 0 else None
                self._bones.append((joint, bone, rest.to_quaternion(), head))
        self._number = skeleton.number
        if len(self._bones) < len(skeleton.names):  # the user's own rig
            found = guess_joints([bone.name for bone in bones])
            check_joints(self.name, found)
            self._retarget = Retarget(self.armature, skeleton, found)
            for name in found.values():
                bones[name].rotation_mode = "QUATERNION"

    def _channels(self, pose):
        """Return pose bones with rotation, and location at the root, converted from joint axes to the rest axes of bones."""
        if self._retarget is not None:
            yield from self._retarget.channels(pose)
            return
        for joint, bone, rest, head in self._bones:
            w, x, y, z = pose.rotations[joint]
            turn = rest.inverted() @ Quaternion((w, x, -z, y)) @ rest
            place = None if head is None else rest.inverted() @ (to_blender(pose.position) - head)
            yield bone, turn, place

    def keep(self, first_frame=1):
        """Write the recording as an action of the armature at the scene's rate; returns the number of keys per curve."""
        poses, self.recorded, thing = self.recorded, [], self.armature
        if not poses or thing is None:
            return 0
        render = self._context.scene.render
        fps = render.fps / render.fps_base
        by_frame = {first_frame + round((pose.seconds - poses[0].seconds) * fps): pose for pose in poses}
        keys = self._keys(sorted(by_frame.items()))
        action = bpy.data.actions.new(f"{thing.name} take")
        (thing.animation_data or thing.animation_data_create()).action = action
        for (name, path, index), values in keys.items():
            curve = _new_curve(action, thing, f'pose.bones["{name}"].{path}', index)
            curve.keyframe_points.add(len(values) // 2)
            curve.keyframe_points.foreach_set("co", values)
            curve.update()
        return len(by_frame)

    def _keys(self, poses):
        """Return frames and values of each curve, by bone, path and index."""
        keys = {}
        for frame, pose in poses:
            for bone, turn, place in self._channels(pose):
                location = () if place is None else place
                for path, values in (("rotation_quaternion", turn), ("location", location)):
                    for index, value in enumerate(values):
                        keys.setdefault((bone.name, path, index), []).extend((float(frame), value))
        return keys

    def close(self):
        """Stop listening."""
        self.receiver.close()


def _new_curve(action, thing, path, index):
    if hasattr(action, "fcurves") and not hasattr(action, "fcurve_ensure_for_datablock"):
        return action.fcurves.new(path, index=index)
    return action.fcurve_ensure_for_datablock(thing, path, index=index)


# --- Blender: menus and panel

running = {}  # "link": the active live link


def _timer():
    """Update the link; called by Blender 60 times per second while it is on."""
    link = running.get("link")
    if link is None:
        return None
    try:
        if link.step():
            _redraw()
    except ValueError as error:
        link.receiver.problem = str(error)
    return 1.0 / 60.0


def _redraw():
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _stop():
    link = running.pop("link", None)
    if link is not None:
        link.close()


if bpy is not None:

    class ImportTake(bpy.types.Operator, ImportHelper):
        """Import a take of the SPORT viewer (BVH, or GLB with its character) with prompts and ground"""

        bl_idname = "import_anim.sport_take"
        bl_label = "Import SPORT take"
        bl_options: ClassVar = {"REGISTER", "UNDO"}
        filename_ext = ".bvh"
        filter_glob: bpy.props.StringProperty(default="*.bvh;*.glb", options={"HIDDEN"})
        first_frame: bpy.props.IntProperty(name="First frame", default=1)
        ground: bpy.props.StringProperty(
            name="Ground", description="OBJ or GLB; empty: the one next to the take", subtype="FILE_PATH"
        )

        def execute(self, context):
            try:
                import_take(context, self.filepath, bpy.path.abspath(self.ground), self.first_frame)
            except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            return {"FINISHED"}

    class SwitchLink(bpy.types.Operator):
        """Follow the running viewer: start it with --live-link, or turn on Live link in its Scene panel"""

        bl_idname = "sport.live_link"
        bl_label = "Live link"

        def execute(self, context):
            if "link" in running:
                _stop()
                return {"FINISHED"}
            scene = context.scene
            try:
                host, port = parse_address(scene.sport_address)
                running["link"] = LiveLink(context, host, port, scene.sport_armature)
            except (OSError, ValueError) as error:
                self.report({"ERROR"}, f"{scene.sport_address}: {error}")
                return {"CANCELLED"}
            bpy.app.timers.register(_timer, persistent=True)
            return {"FINISHED"}

    class SwitchRecording(bpy.types.Operator):
        """Record the live link; click again to write an action from frame 1 on"""

        bl_idname = "sport.record"
        bl_label = "Record"

        def execute(self, context):
            link = running.get("link")
            if link is None:
                return {"CANCELLED"}
            if link.recording:
                self.report({"INFO"}, f"{link.keep()} frames recorded")
            link.recording = not link.recording
            return {"FINISHED"}

    class LivePanel(bpy.types.Panel):
        """Address, armature, and reception of the live link"""

        bl_idname = "VIEW3D_PT_sport"
        bl_label = "SPORT viewer"
        bl_space_type = "VIEW_3D"
        bl_region_type = "UI"
        bl_category = "SPORT"

        def draw(self, context):
            layout, scene, link = self.layout, context.scene, running.get("link")
            column = layout.column()
            column.enabled = link is None
            column.prop(scene, "sport_address")
            column.prop(scene, "sport_armature")
            layout.operator("sport.live_link", text="Stop" if link else "Start", depress=link is not None)
            if link is None:
                return
            layout.operator("sport.record", text="Stop recording" if link.recording else "Record")
            receiver = link.receiver
            layout.label(text=f"{receiver.received} poses, {100 * receiver.lost_share:.1f} % lost")
            if receiver.problem:
                layout.label(text=receiver.problem, icon="ERROR")

    CLASSES = (ImportTake, SwitchLink, SwitchRecording, LivePanel)


def _menu(menu, _context):
    menu.layout.operator("import_anim.sport_take", text="SPORT take (.bvh, .glb)")


def register():
    """Add the menus and the panel; Blender calls it when the add-on is enabled."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    scene, props = bpy.types.Scene, bpy.props
    scene.sport_address = props.StringProperty(
        name="Listen at",
        description="Address and port; 127.0.0.1 receives only from this computer",
        default=f"{DEFAULT_ADDRESS[0]}:{DEFAULT_ADDRESS[1]}",
    )
    scene.sport_armature = props.PointerProperty(
        name="Armature",
        description="Your own rig, or one with the viewer's joint names; empty: a new one",
        type=bpy.types.Object,
        poll=lambda _, thing: thing.type == "ARMATURE",
    )
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister():
    """Remove everything that `register` added; Blender calls it when the add-on is disabled."""
    _stop()
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
    del bpy.types.Scene.sport_address, bpy.types.Scene.sport_armature
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)


def main(arguments):
    """Listen without Blender and print the received poses."""
    host, port = parse_address(arguments[0] if arguments else "")
    seconds = float(arguments[1]) if len(arguments) > 1 else math.inf
    receiver, end = Receiver(host, port), time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            time.sleep(min(1.0, seconds))
            poses = receiver.drain()
            at = " ".join(f"{v:.2f}" for v in poses[-1].position) if poses else "nothing"
            print(f"{receiver.received} poses, {receiver.lost} lost; {at}", flush=True)
    except KeyboardInterrupt:
        return 130
    finally:
        receiver.close()
    return 0


if __name__ == "__main__":
    if bpy is not None:  # run as a script inside Blender
        register()
    else:
        sys.exit(main(sys.argv[1:]))
