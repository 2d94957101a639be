"""The paper's networks in torch, one file per box of its Fig. 2 to 5."""
