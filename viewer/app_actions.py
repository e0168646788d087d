# SPDX-License-Identifier: Apache-2.0
"""What a person can have done, by keys or by panels."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from geopage.fields import attribute_names
from geopage.selection import Thresholds
from geopage.style import Style
from tiles.errors import InputError
from viewer.app_search import Hit
from viewer.app_shot import Shot
from viewer.bookmarks import Bookmark, bookmark_of, write_bookmarks
from viewer.camera import Pose
from viewer.camera_path import CameraPath, read_path
from viewer.governor import Governor
from viewer.pick import find_drawn, pick

if TYPE_CHECKING:
    from viewer.app import App

OWN_FIELDS = "height_m", "dimension_m", "source"


class Actions:
    """Everything that one can do with an app, besides flying by hand."""

    def __init__(self, app: "App") -> None:
        self._app = app
        self._fields: list[str] | None = None
        self._sought: int | None = None
        """id of a building to be marked as soon as it is drawn"""

    def fly_to(self, pose: Pose) -> None:
        """Fly somewhere by itself."""
        self._app.replayer.stop()
        self._app.navigator.fly_to(pose)

    def go_to(self, hit: Hit) -> None:
        """Fly to something found, and show a building's card as if it were clicked."""
        self.fly_to(hit.pose(self._app.ground.below))
        self.unpick()
        if hit.number is None:
            return
        (one,) = self._app.session.store.objects([hit.number])
        height_m = one["base_m"] + one["height_m"]
        place = {key: one[key] for key in ("lat_deg", "lon_deg")} | {"height_m": height_m}
        self._app.state.picked = place | {"kind": "building", "object": one}
        self._sought = hit.number

    def step(self) -> None:
        """Mark the building that was flown to, once it is drawn."""
        app = self._app
        there = app.resting and not app.loading and not app.navigator.moving
        if self._sought is None or app.drawn is None or not there:
            return
        found = find_drawn(app.session, app.drawn, self._sought)
        self._sought = None
        app.state.overlay = replace(app.state.overlay, picked=found)

    def approach(self, x: float, y: float) -> None:
        """Fly to what is drawn at a pixel."""
        self._app.replayer.stop()
        self._app.navigator.approach(x, y)

    def inspect(self, x: float, y: float) -> None:
        """Say what is drawn at a pixel, or take it as a point of the measurement."""
        if self._app.drawn is None:
            return
        state = self._app.state
        if state.measuring:
            if (point := self._app.touch(x, y)) is not None:
                state.points = [*state.points, point] if len(state.points) < 2 else [point]
            return
        self._sought = None
        found = pick(self._app.session, self._app.drawn, (int(x), int(y)))
        if found["kind"] == "ground":  # what is drawn may be coarse here
            place = math.radians(found["lon_deg"]), math.radians(found["lat_deg"])
            found["height_m"] = self._app.ground.height_m(*place)
        state.picked = None if found["kind"] == "sky" else found
        marked = self._marked(int(x), int(y)) if found["kind"] == "building" else None
        state.overlay = replace(state.overlay, picked=marked)

    def _marked(self, x: int, y: int) -> tuple[int, int]:
        assert self._app.drawn
        shown = int(self._app.session.renderer.read_ids()[y, x])
        entry, ordinal = divmod(-1 - shown, 1 << 16)
        return int(self._app.drawn.objects[entry]), ordinal

    def unpick(self) -> None:
        """Forget what was clicked."""
        self._sought = None
        self._app.state.picked = None
        self._app.state.overlay = replace(self._app.state.overlay, picked=None)

    def set_threshold(self, threshold_px: float) -> None:
        """Draw with another threshold; it is the finest where a frame rate is held."""
        self._app.state.threshold_px = threshold_px
        if self._app.governor:
            self._app.governor.limits = self._limits()
        else:
            limits = self._limits()
            self._app.session.pager.set_limits(limits.terrain_px, limits.objects_px)

    def _limits(self) -> Thresholds:
        state = self._app.state
        objects_px = state.object_threshold_px or state.threshold_px
        return Thresholds(state.threshold_px, objects_px)

    def set_fps(self, fps: float | None) -> None:
        """Hold a frame rate by coarser detail, or None: draw as fine as the threshold."""
        app = self._app
        app.state.fps = fps
        app.governor = Governor(app.session, self._limits(), fps) if fps else None
        self.set_threshold(app.state.threshold_px)

    def fields(self) -> list[str]:
        """Return by which fields buildings can be coloured; they are looked up once."""
        if self._fields is None:
            store = self._app.session.store
            names = attribute_names(store) if store.object_count() else []
            self._fields = [*names, *OWN_FIELDS] if names else []
        return self._fields

    def set_style(self, field: str) -> None:
        """Colour the buildings by a field, or with an empty name as they are."""
        try:
            self._app.session.set_style(Style(field) if field else None)
        except InputError as error:
            self._app.say(str(error))
        else:
            self._app.state.style = field
            self._app.redraw()

    def set_policy(self, name: str) -> None:
        """Page by another policy."""
        self._app.state.policy = name
        self._app.session.pager.set_policy(name)

    def freeze(self, *, on: bool) -> None:
        """Keep what is selected while the eye moves, or follow the eye again."""
        self._app.state.frozen = on
        self._app.told.again()
        follows = "the selection follows the view again"
        self._app.say("selection frozen: look at it from anywhere" if on else follows)

    def measure(self, *, on: bool | None = None) -> None:
        """Begin to measure, or end it."""
        self._app.state.measuring = not self._app.state.measuring if on is None else on
        self._app.state.points = []
        if self._app.state.measuring:
            self._app.say("measure: click two points")

    def take_picture(self) -> None:
        """Save a picture of this view when it is settled."""
        if self._app.shot is None:
            self._app.shot = Shot(self._app)

    def record(self) -> None:
        """Begin to record a tour, or end and save it."""
        self._app.recorder.toggle(self._app)

    def replay(self, path: CameraPath) -> None:
        """Fly a camera path."""
        self._app.navigator.stop()
        self._app.replayer.start(path, self._app.now_s)

    def replay_last(self) -> None:
        """Fly the tour that was saved last."""
        if self._app.replayer.last is not None:
            try:
                self.replay(read_path(self._app.replayer.last))
            except InputError as error:
                self._app.say(str(error))

    def add_bookmark(self, name: str = "") -> None:
        """Keep this view."""
        state = self._app.state
        title = name or f"Place {len(state.bookmarks) + 1}"
        self.keep_bookmarks(
            [*state.bookmarks, bookmark_of(title, self._app.navigator.pose)]
        )

    def keep_bookmarks(self, bookmarks: list[Bookmark]) -> None:
        """Take over bookmarks and write them down."""
        self._app.state.bookmarks = bookmarks
        try:
            file = write_bookmarks(self._app.session.store.path, bookmarks)
        except InputError as error:
            self._app.say(str(error))
        else:
            self._app.say(f"bookmarks saved: {file}")
