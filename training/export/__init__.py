"""From trained weights to ONNX files, their 8-bit twin and the model card."""
