# SPDX-License-Identifier: Apache-2.0
"""The methods that `geopage bench` compares, all on the same engine and data.

A method says what to draw for a view and a threshold. Settled, that is what it selects
when every tile is there; paced, the pager flies it. A method that the engine can't fly
has no paced mode, and one that differs only in motion has no settled one. A method that
is not built is absent, and said to be.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.settings import DETAILS, PagerSettings
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.lanes import Lane
from viewer.bench_choices import by_faces, by_range, without_proxies

SETTLED, PACED = "settled", "paced"
Forests = Mapping[Lane, Forest]
Choice = Callable[[Forests, ViewState, float], DrawList]
PLAIN = PagerSettings()


@dataclass(frozen=True, slots=True)
class Method:
    """One way to choose what is drawn."""

    name: str
    about: str
    object_ratio: float = 1.0
    """Object threshold / threshold"""
    detail: str = DETAILS[0]
    policy: str = PLAIN.policy
    choice: Choice | None = None
    """Its own selection, which the pager does not know"""
    mesh: str = ""
    """Its own meshes of the ground: of `bench_meshes.SIDES`"""

    @property
    def moves(self) -> bool:
        """Whether it differs from ours only in motion."""
        return self.detail != DETAILS[0] or self.policy != PLAIN.policy

    @property
    def is_ours(self) -> bool:
        """Whether it is what geopage does when nothing else is said."""
        return self == Method(self.name, self.about)

    @property
    def modes(self) -> tuple[str, ...]:
        """In which modes the method can be measured."""
        if self.choice or self.mesh:
            return (SETTLED,)
        return (PACED,) if self.moves else (SETTLED, PACED)

    def settings(self, threshold_px: float, budget_bytes: int) -> PagerSettings:
        """Return what the pager needs to fly the method."""
        objects_px = self.object_ratio * threshold_px
        return PagerSettings(
            threshold_px, objects_px, budget_bytes, policy=self.policy, detail=self.detail
        )

    def draw_list(self, forests: Forests, view: ViewState, threshold_px: float) -> DrawList:
        """Return what the method draws when every tile is there."""
        if self.choice:
            return self.choice(forests, view, threshold_px)
        return ideal(forests, view, threshold_px, self.object_ratio * threshold_px)


METHODS = (
    Method("geopage", "terrain, proxies and buildings at the same threshold"),
    Method(
        "buildings at 10 x",
        "buildings only where they span 10 thresholds, their proxies before: Davis and"
        " others, 1999, used 1 px for proxies and 10 px for buildings",
        object_ratio=10.0,
    ),
    Method(
        "without proxies",
        "buildings that span the threshold, and nothing for those that don't",
        choice=without_proxies,
    ),
    Method(
        "regular grid",
        "each terrain tile is a full lattice of 64 x 64 squares, with its error measured;"
        " the lattice is resampled from tiles two levels finer, as the sources' own posts"
        " are not read while drawing",
        mesh="grid",
    ),
    Method(
        "RTIN",
        "each terrain tile is a right-triangulated network of a lattice of 128 x 128"
        " squares within our tiles' error bounds, but at the lattice's posts alone, as the"
        " literature has it (Evans and others, 2001; martini); resampled likewise",
        mesh="rtin",
    ),
    Method(
        "pixels per face",
        "ground is refined while a tile's triangles span more than 8 thresholds, whatever"
        " they err: Funkhouser, Sequin and Teller, 1992, section 5.1, who held the pixels"
        " of faces against a limit",
        choice=by_faces,
    ),
    Method(
        "all within a range",
        "no levels of detail: the finest ground and all buildings up to the distance at"
        " which a building of 20 m spans the threshold, and nothing beyond: REVIEW (Shou"
        " and others, 2001) showed 1 km",
        choice=by_range,
    ),
    Method(
        "by size and speed",
        "less detail where things move fast across the screen: Funkhouser, Sequin and"
        " Teller, 1992, section 5.1; when nothing moves it is geopage",
        detail=DETAILS[1],
    ),
    Method(
        "level by level",
        "tiles are asked for as by today's engines: the children of what is drawn too"
        " coarsely, the largest screen error first, no level skipped, nothing foreseen;"
        " when all is there it is geopage (engines often stop at 16 px)",
        policy="strict",
    ),
)


ABSENT = (
    "Not built, so not compared: pictures in place of far objects (MMR's impostors), the"
    " visibility from cell to cell of the Berkeley walkthrough, and one mesh for the whole"
    " view as a floor of triangles. Buildings have no geometric error yet: what they are"
    " worth shows in FLIP and PSNR alone."
)


def that_differ(methods: Sequence[Method], forests: Forests) -> list[Method]:
    """Return the methods but those about buildings where there are none."""
    if len(forests[Lane.OBJECTS].records):
        return list(methods)
    return [
        one
        for one in methods
        if one.choice is not without_proxies and one.object_ratio == 1.0
    ]
