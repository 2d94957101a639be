"""What the processor's 8-bit arithmetic is worth: without VNNI, pairs of products are added in 16 bits and overflow."""

from __future__ import annotations

import numpy as np

# An ONNX graph of one MatMulInteger, y = a b with a unsigned and b signed, as `step_int8.onnx` has them. Bytes, because
# the runtime does without the package that would build it.
PRODUCT = (
    b'\x08\x08:b\n\x18\n\x01a\n\x01b\x12\x01y"\rMatMulInteger\x12\x01p'
    b"Z\x15\n\x01a\x12\x10\n\x0e\x08\x02\x12\n\n\x03\x12\x01m\n\x03\x12\x01k"
    b"Z\x15\n\x01b\x12\x10\n\x0e\x08\x03\x12\n\n\x03\x12\x01k\n\x03\x12\x01n"
    b"b\x15\n\x01y\x12\x10\n\x0e\x08\x06\x12\n\n\x03\x12\x01m\n\x03\x12\x01nB\x04\n\x00\x10\x12"
)


def exact_8_bit_products() -> bool:
    """Whether onnxruntime multiplies 8-bit matrices without overflow here: tried with the largest numbers there are."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(PRODUCT, options, providers=["CPUExecutionProvider"])
    a, b = np.full((2, 64), 255, np.uint8), np.full((64, 16), 127, np.int8)
    (y,) = session.run(None, {"a": a, "b": b})
    return bool(np.array_equal(y, a.astype(np.int32) @ b.astype(np.int32)))
