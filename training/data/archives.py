"""The archives of motion capture: whom to credit, and which may go into weights that anybody may publish."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Archive:
    """One archive; `free` ones allow commercial use with the credit."""

    name: str
    credit: str
    free: bool = True


ARCHIVES = (
    Archive("o3de", "Copyright (c) Contributors to the Open 3D Engine Project (Apache-2.0 or MIT)"),
    Archive("accad", "ACCAD, The Ohio State University (CC BY 3.0)"),
    Archive("100style", "The 100STYLE Dataset - Ian Mason (CC BY 4.0)"),
    Archive("100style_more", "The 100STYLE Dataset - Ian Mason (CC BY 4.0)"),
    Archive("bandai_namco", "Bandai Namco Research Motiondataset (CC BY-NC 4.0)", free=False),
    Archive("cmu", "Data from mocap.cs.cmu.edu, created with funding from NSF EIA-0196217"),
    Archive("cmu91", "CMU subject 91: mocap.cs.cmu.edu, created with funding from NSF EIA-0196217"),
    Archive("fair_zombie", "Zombie walk: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)"),
    Archive("jlpm", "José Luis Pontón, locomotion take (MIT)"),
    Archive(
        "pfnn",
        "Holden et al. 2017, Phase-Functioned Neural Networks (academic, non-commercial)",
        free=False,
    ),
    Archive(
        "pfnn_rollouts",
        "Rollouts of the published PFNN, Holden et al. 2017 (academic, non-commercial)",
        free=False,
    ),
)
BY_NAME = {archive.name: archive for archive in ARCHIVES}
NON_COMMERCIAL = "non-commercial: trained also on CC BY-NC and academic data"
FREE = "CC BY 4.0: may be published and used commercially with the credits"


def credits_of(sources: set[str]) -> list[str]:
    """A line for each archive, in a stable order, none twice; KeyError for one that is unknown."""
    return list(dict.fromkeys(BY_NAME[name].credit for name in sorted(sources)))


def licence_of(sources: set[str]) -> str:
    """What may be done with weights that were trained on these archives."""
    return FREE if all(BY_NAME[name].free for name in sources) else NON_COMMERCIAL
