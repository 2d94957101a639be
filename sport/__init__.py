"""SPORT viewer: prompts to real-time locomotion.  `sport.runtime`, `sport.viewer`, `sport.training` and `sport.benchmarks`.

In a checkout these folders lie beside this one, in an installed wheel inside it.
"""

from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
if (_ROOT / "pyproject.toml").is_file():
    __path__.append(str(_ROOT))
