"""Export of trained weights: ONNX graphs, their 8-bit version and the model card."""
