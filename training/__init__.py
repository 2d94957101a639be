"""The paper's training and evaluation: data sets, networks, stages, export and metrics (extra `[train]`)."""
