# SPDX-License-Identifier: Apache-2.0
"""Which experiments there are, and running them one after the other."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from geopage.progress import bar
from tiles.errors import InputError
from viewer.charts import pyplot
from viewer.experiments.chart import draw
from viewer.experiments.report import Json, Part, write
from viewer.experiments.rows import Chart, Found, Progress
from viewer.experiments.setting import Setting
from viewer.gl import Gl, open_headless
from viewer.machine import commit, host

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Experiment:
    """One experiment: where it comes from, and what stands in for what was there."""

    title: str
    paper: str
    about: str
    module: str

    @property
    def run(self) -> Callable[[Setting, Progress], Found]:
        """What runs it; its module is only loaded when it is wanted."""
        found: Callable[[Setting, Progress], Found] = import_module(
            f"viewer.experiments.{self.module}"
        ).run
        return found


EXPERIMENTS = {
    "E1": Experiment(
        "operating system or predictive cache, data 1.07 times the memory",
        "Funkhouser, Database Management for Interactive Display of Large Architectural"
        " Models, 1996",
        "A city of boxes, each drawn whole or not at all, stands for the two floors of"
        " Soda Hall, at a tenth of the size, driven through and back. An LRU model of 4"
        " KiB pages behind a disk of the time (14 ms, 2 MB/s) stands for virtual memory,"
        " our pager behind the same disk for theirs. All by a virtual clock; the time"
        " to draw is set so that frames without a stall take their mean of 63 ms.",
        "os_paging",
    ),
    "E2": Experiment(
        "what each stage of culling and of detail leaves",
        "Funkhouser, Séquin, Teller, Management of Large Amounts of Data in Interactive"
        " Building Walkthroughs, 1992, and Aliaga et al., MMR, 1999",
        "San Francisco's 13,024 buildings stand for a building and for a power plant, a"
        " walk in the street and a flight around for their paths. Cells and portals,"
        " textured depth meshes and occlusion culling are not built.",
        "cull_chain",
    ),
    "E3": Experiment(
        "complement search, culling and prefetching among 900,000 boxes",
        "Shou et al., Walking Through a Very Large Virtual Environment in Real-time"
        " (REVIEW), 2001",
        "Their retrieval is built again on generated data of the same shape: boxes 10"
        " to 30 m apart, 222 bytes each on disk and 1,193 in memory, a view of 60 by 60"
        " degrees and 1 km, a memory of 20 MB, an index cache of 1 MB. Their R-tree grew"
        " by insertion, ours is packed; the speeds of the five sessions, and SF of"
        " table 1 (1.5), are ours. geopage's own pager walks the same sessions.",
        "complement",
    ),
    "E4": Experiment(
        "how small a cache may be",
        "Aliaga et al., MMR, 1999",
        "The city of E3 and the sample world stand for the power plant; each path"
        " passes every place twice. Without textured depth meshes there is one cache.",
        "cache_knee",
    ),
    "E5": Experiment(
        "the fly-in, with and without the hierarchy",
        "Davis et al., Hierarchical Paging of Buildings on Global Terrain (VGIS), 1999",
        "A made-up downtown of 471 buildings on San Francisco's terrain stands for"
        " Atlanta, then 4, 16 and 64 of it side by side, as the paper planned. Real"
        " frames, drawn when all is there; of each view the shortest of 3 draws counts."
        " The numbers in its figures 3 to 7 are not in our copy of the paper.",
        "fly_in",
    ),
    "E6": Experiment(
        "the stall of a fast fly-in behind slow servers",
        "Davis et al., Hierarchical Paging of Buildings on Global Terrain (VGIS), 1999",
        "The paper tells of the stall and of its cure and gives no figure. Our sample"
        " fly-in, 10,000 km to 10 m in 30 s, by a virtual clock. Our index is in memory"
        " in all rows: the stall of reading the tree itself cannot be had here.",
        "stall",
    ),
}


DRAWING = ("E2", "E5")
"""They use the GPU"""


def run_all(setting: Setting, keys: Sequence[str]) -> list[Part]:
    """Run experiments; after each, all that is done is written.

    Raises
    ------
    InputError
    """
    try:
        setting.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        advice = "name a folder that can be made"
        raise InputError(setting.out, str(error.strerror or error), advice) from error
    if setting.store:
        setting.world()  # whether it can be used is said before anything is measured
    pyplot(setting.out)  # whether there is one, likewise
    about = about_of(setting, keys)
    note = f"{about['machine']}; {about['gl_renderer']}; commit {about['commit']}"
    parts: list[Part] = []
    charts: dict[str, list[tuple[Chart, Path]]] = {}
    for key in keys:
        one = EXPERIMENTS[key]
        with bar(f"{key}, {one.title[:40]}", 100, "%") as show:
            found = one.run(setting, show)
        parts.append(Part(key, one.title, one.paper, one.about, found))
        charts[key] = [(chart, draw(chart, setting.out, note)) for chart in found.charts]
        write(setting.out, parts, charts, about)
    return parts


def about_of(setting: Setting, keys: Sequence[str]) -> Json:
    """Return what the header says."""
    where = host()
    only = "" if len(keys) == len(EXPERIMENTS) else f" --only {','.join(keys)}"
    quick = " --quick" if setting.quick else ""
    return {
        "command": f"geopage experiments --out DIR{only}{quick}",
        "machine": f"{where['cpu']}, {where['cores']} cores",
        "gl_renderer": renderer() if {*keys} & {*DRAWING} else "none used",
        "load": f"{os.getloadavg()[0]:.1f} when it began, of all work on the machine",
        "python": where["python"],
        "commit": commit() or "unknown",
    }


def renderer() -> str:
    """Return what draws here."""
    gl = Gl(open_headless())
    try:
        return str(gl.context.info["GL_RENDERER"])
    finally:
        gl.context.release()
