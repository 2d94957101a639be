"""Targets that are networks: model folders, text encoders, and an endpoint's answers on the wire."""

import hashlib
import json
import random
import shutil
import socket
import threading
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.model import load_model
from runtime.prompts.content import PromptEncoder
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.text_encoder import TextEncoder, text_encoder_of
from runtime.terrain.height_map import Terrain

from .mutate import damaged_bytes, damaged_json, damaged_text
from .networks import GRAPHS, write_model, write_text_encoder
from .target import Target

_SIX = PartDescriptions(*["walk proud"] * 6)


def _walk(folder: Path) -> None:
    model = load_model(folder)
    model.name.encode()
    words = text_encoder_of(model.metadata, model.folder)
    style = PromptEncoder(words, model.prompt_path).encode(_SIX)
    controller = Controller(model, Terrain.flat())
    controller.set_style(style, 0.1)
    for _ in range(2):
        assert np.isfinite(controller.step(Controls((0.0, 1.0))).positions).all()


def _metadata_seeds(folder: Path) -> list[bytes]:
    return [(write_model(folder / "model") / "metadata.json").read_bytes()]


def _read_metadata(folder: Path, data: bytes) -> None:
    (folder / "model" / "metadata.json").write_bytes(data)
    _walk(folder / "model")


def _graph_seeds(folder: Path) -> list[bytes]:
    write_model(folder / "good")
    return [name.encode() for name in GRAPHS]


def _damaged_graph(rng: random.Random, name: bytes) -> bytes:
    """The name of a graph, and the seed of the damage to it."""
    return name + b" " + str(rng.getrandbits(40)).encode()


def _read_graph(folder: Path, data: bytes) -> None:
    name, seed = (data.decode() + " 0").split()[:2]
    good, target = folder / "good", folder / "input"
    if not target.is_dir():
        shutil.copytree(good, target)
    for other in GRAPHS:
        shutil.copyfile(good / f"{other}.onnx", target / f"{other}.onnx")
    graph = damaged_bytes(random.Random(seed), (good / f"{name}.onnx").read_bytes())
    (target / f"{name}.onnx").write_bytes(graph)
    metadata = json.loads((good / "metadata.json").read_text("utf-8"))
    metadata["sha256"][name] = hashlib.sha256(graph).hexdigest()
    (target / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
    _walk(target)


_ENCODER_FILES = ("text_encoder.json", "tokenizer.json", "tiny.onnx")


def _encoder_seeds(folder: Path) -> list[bytes]:
    write_text_encoder(folder / "good")
    return [name.encode() for name in _ENCODER_FILES]


def _pieces_seeds(folder: Path) -> list[bytes]:
    write_text_encoder(folder / "good", unigram=True)
    return [b"tokenizer.json"]


def _read_encoder(folder: Path, data: bytes) -> None:
    name, seed = (data.decode() + " 0").split()[:2]
    good, target = folder / "good", folder / "input"
    target.mkdir(exist_ok=True)
    for other in _ENCODER_FILES:
        shutil.copyfile(good / other, target / other)
    damage = damaged_bytes if name.endswith("onnx") else damaged_json
    (target / name).write_bytes(damage(random.Random(seed), (good / name).read_bytes()))
    encoder = TextEncoder(target)
    encoder.name.encode()
    vectors = encoder.encode(["a proud walk", "ein müder König, 疲れた", "x " * 300])
    assert np.isfinite(vectors).all()
    assert vectors.shape == (3, encoder.dimensions)


# --- an endpoint
class _Endpoint:
    """A server on loopback that answers every request with the same bytes and hangs up."""

    def __init__(self) -> None:
        self.answer = b""
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            connection, _ = self._socket.accept()
            with connection:
                connection.settimeout(5.0)
                try:
                    received = b""
                    while b"\r\n\r\n" not in received:
                        received += connection.recv(65536)
                    connection.sendall(self.answer)
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(65536):
                        continue
                except OSError:  # the client went away
                    continue


@cache
def _server() -> tuple[_Endpoint, Any]:
    from runtime.prompts.gpt.client import ChatClient
    from runtime.prompts.gpt.settings import GptSettings, Secret

    endpoint = _Endpoint()
    url, limits = f"http://127.0.0.1:{endpoint.port}/v1", {"timeout_s": 2.0, "deadline_s": 2.0}
    return endpoint, ChatClient(GptSettings(Secret("key"), url, attempts=1, **limits))


def _wire_seeds(_folder: Path) -> list[bytes]:
    import gzip

    body = json.dumps({"choices": [{"message": {"content": "{}"}}]}).encode()
    packed = gzip.compress(body * 50, mtime=0)
    head = b"HTTP/1.1 %s\r\nContent-Type: application/json\r\nContent-Length: %d\r\n"
    return [
        head % (b"200 OK", len(body)) + b"\r\n" + body,
        head % (b"500 no", len(body)) + b"\r\n" + body,
        head % (b"200 OK", len(packed)) + b"Content-Encoding: gzip\r\n\r\n" + packed,
        b"HTTP/1.1 429 wait\r\nRetry-After: 1\r\nTransfer-Encoding: chunked\r\n\r\n5\r\n[1,2]\r\n0\r\n\r\n",
        b"HTTP/1.1 307 there\r\nLocation: http://127.0.0.1:9/v1\r\nContent-Length: 0\r\n\r\n",
    ]


def _ask(_folder: Path, data: bytes) -> None:
    import time

    endpoint, client = _server()
    endpoint.answer = data
    client.complete([{"role": "user", "content": "?"}], None, time.monotonic() + 2.0, threading.Event())


TARGETS = (
    Target("model metadata", _metadata_seeds, damaged_json, _read_metadata, 0.5),
    Target("model graphs", _graph_seeds, _damaged_graph, _read_graph, 0.5),
    Target("text encoder", _encoder_seeds, _damaged_graph, _read_encoder, 0.5),
    Target("tokenizer of pieces", _pieces_seeds, _damaged_graph, _read_encoder, 0.5),
    Target("endpoint on the wire", _wire_seeds, damaged_text, _ask, 0.2),
)
