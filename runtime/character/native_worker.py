"""The worker process of `native`: converts one file to another with a native library.

It is a separate process, so that a damaged file can crash only this process and not the program.
"""

import io
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

PR_SET_PDEATHSIG = 1  # of linux/prctl.h


def main(kind: str, folder: str, memory: str, cpu_s: str) -> None:
    """Decode the file "in" of a folder into "out", with the parameters of "facts.json"; exit with 0, or with 1 and an error message."""
    try:
        decode = DECODERS[kind]()
        facts = json.loads((Path(folder) / "facts.json").read_text(encoding="utf-8"))
        _limit(int(memory), int(cpu_s))
        Path(folder, "out").write_bytes(decode(facts, Path(folder, "in")))
    except Exception as error:  # the errors of four libraries share no base class; all concern the file
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)  # skips the destructors of ufbx's objects, which crash after their scene


def _limit(memory: int, cpu_s: int) -> None:
    """Limit this process's resources; Windows and macOS have the caller's time limit only."""
    if sys.platform == "linux":
        import ctypes
        import resource

        # ends with its caller in any case
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


Decoder = Callable[[Any, Path], bytes]


def _meshopt() -> Decoder:
    """Decode meshopt. Facts: `views`, each with mode, filter, count, stride and byte length. Returns the concatenated bytes."""
    import meshoptimizer as codec

    filters = {
        "OCTAHEDRAL": codec.decode_filter_oct,
        "QUATERNION": codec.decode_filter_quat,
        "EXPONENTIAL": codec.decode_filter_exp,
    }

    def view(packed: dict[str, Any], data: np.ndarray) -> bytes:
        count, stride = packed["count"], packed["stride"]
        if packed["mode"] != "ATTRIBUTES":
            triangles = packed["mode"] == "TRIANGLES"
            decode = codec.decode_index_buffer if triangles else codec.decode_index_sequence
            indices: np.ndarray = decode(count, 4, data)
            return indices.astype({2: np.uint16, 4: np.uint32}[stride]).tobytes()
        values = codec.decode_vertex_buffer(count, stride, data).view(np.uint8)
        if packed["filter"] != "NONE":
            values = filters[packed["filter"]](values, count, stride)
        result: bytes = values.tobytes()
        return result

    def decode(facts: Any, source: Path) -> bytes:
        data, made, at = np.frombuffer(source.read_bytes(), np.uint8), bytearray(), 0
        for packed in facts["views"]:
            made += view(packed, data[at : at + packed["length"]])
            at += packed["length"]
        return bytes(made)

    return decode


def _draco() -> Decoder:
    """Decode Draco. Facts: `parts`, each with byte length and attribute ids. Returns an NPZ of "PART.indices" and "PART.ID"."""
    import DracoPy as codec

    def decode(facts: Any, source: Path) -> bytes:
        data, arrays, at = source.read_bytes(), {}, 0
        for k, part in enumerate(facts["parts"]):
            mesh = codec.decode(data[at : at + part["length"]])
            at += part["length"]
            arrays[f"{k}.indices"] = np.asarray(mesh.faces).reshape(-1, 1)
            for number in part["attributes"]:
                arrays[f"{k}.{number}"] = np.asarray(mesh.get_attribute_by_unique_id(number)["data"])
        out = io.BytesIO()
        np.savez(out, **arrays)  # type: ignore[arg-type]
        return out.getvalue()

    return decode


def _ktx2() -> Decoder:
    """Decode an image to RGBA bytes."""
    import opengl_basisu as codec

    def decode(facts: Any, source: Path) -> bytes:
        image = codec.open(source.read_bytes()).transcode(codec.Target.RGBA8)
        return np.ascontiguousarray(image.data).tobytes()

    return decode


def _fbx() -> Decoder:
    """Convert an FBX to GLB. Facts: its `path`, and whether `motion` is requested."""
    import ufbx  # noqa: F401 (before memory is limited)

    from runtime.character.fbx_to_glb import convert

    return lambda facts, source: convert(Path(facts["path"]), facts["motion"])


DECODERS = {"meshopt": _meshopt, "draco": _draco, "ktx2": _ktx2, "fbx": _fbx}
