# SPDX-License-Identifier: Apache-2.0
"""Panels: finding places, bookmarks, measuring, pictures and tours."""

from typing import TYPE_CHECKING

from imgui_bundle import ImVec2, imgui

from viewer.hud_style import QUIET, WARM, text_in

if TYPE_CHECKING:
    from viewer.app import App

ROWS = 8
SCALES = 1, 2, 4


class Tools:
    """What is typed and not yet done."""

    def __init__(self) -> None:
        self._words = ""
        self._asked = False
        """and no answer yet"""
        self._name = ""
        self._flights = 0

    def search(self, app: "App") -> None:
        """Draw the box to find things with, and what it found."""
        imgui.set_next_item_width(-1)
        box = f"##find{self._flights}"  # a new box has not the keyboard: keys fly again
        enter = imgui.InputTextFlags_.enter_returns_true
        hint = "Find: 47.37, 8.54 or a name or height>100"
        done, self._words = imgui.input_text_with_hint(box, hint, self._words, enter)
        found = app.search
        if done:
            found.ask(self._words, app.navigator.pose)
            self._asked = True
        if self._asked and not found.on:
            self._asked = False
            if found.best:
                app.do.go_to(found.best)
                self._flights += 1
        if found.message:
            text_in(QUIET, found.message)
        if not found.hits:
            _sources(app)
            return
        rows = min(len(found.hits), ROWS)
        height = rows * imgui.get_text_line_height_with_spacing() + 4
        if imgui.begin_child("hits", ImVec2(0, height)):
            for number, hit in enumerate(found.hits):
                if imgui.selectable(f"{hit.label}##{number}", False)[0]:  # noqa: FBT003
                    app.do.go_to(hit)
        imgui.end_child()
        if imgui.button("Clear"):
            self._words = ""
            found.ask("")

    def draw(self, app: "App") -> None:
        """Draw the sections of tools and bookmarks."""
        if imgui.collapsing_header("Tools", imgui.TreeNodeFlags_.default_open):
            self._tools(app)
        if imgui.collapsing_header("Bookmarks"):
            self._bookmarks(app)

    def _tools(self, app: "App") -> None:
        state = app.state
        if imgui.button("Stop measuring (M)" if state.measuring else "Measure (M)"):
            app.do.measure()
        if imgui.button("Save picture (P)"):
            app.do.take_picture()
        for scale in SCALES:
            imgui.same_line()
            if imgui.radio_button(f"{scale}x", state.shot_scale == scale):
                state.shot_scale = scale
        _tours(app)
        text_in(QUIET, f"saved in {state.out.resolve()}")

    def _bookmarks(self, app: "App") -> None:
        imgui.set_next_item_width(-90)
        enter = imgui.InputTextFlags_.enter_returns_true
        done, self._name = imgui.input_text_with_hint("##name", "Name", self._name, enter)
        imgui.same_line()
        if imgui.button("Add (B)") or done:
            app.do.add_bookmark(self._name)
            self._name = ""
            imgui.internal.clear_active_id()
        for number, one in enumerate(app.state.bookmarks):
            if imgui.button(f"x##{number}"):
                left = [b for b in app.state.bookmarks if b is not one]
                app.do.keep_bookmarks(left)
            imgui.same_line()
            if imgui.selectable(f"{one.name}##{number}", False)[0]:  # noqa: FBT003
                app.do.fly_to(one.pose())
        if not app.state.bookmarks:
            text_in(WARM if self._name else QUIET, "none yet: B keeps this view")


def _sources(app: "App") -> None:
    """Draw what the store holds, each a place to fly to."""
    if not imgui.collapsing_header("Data", imgui.TreeNodeFlags_.default_open):
        return
    line = imgui.get_text_line_height_with_spacing()
    size = ImVec2(0, min(len(app.search.sources), ROWS) * line + 4)
    if imgui.begin_child("sources", size):
        for number, one in enumerate(app.search.sources):
            if imgui.selectable(f"{one.label}##{number}", False)[0]:  # noqa: FBT003
                app.do.go_to(one)
    imgui.end_child()


def _tours(app: "App") -> None:
    """Draw the buttons that record and replay."""
    if app.recorder.on:
        if imgui.button(f"Stop and save (V), {app.recorder.duration_s:.0f} s"):
            app.do.record()
    elif imgui.button("Record tour (V)"):
        app.do.record()
    if app.replayer.on or app.replayer.last:
        _replay(app)
    if app.filming.on:
        if imgui.button("Stop film"):
            app.filming.stop()
        imgui.same_line()
        imgui.text_disabled(f"{app.filming.percent} % done")


def _replay(app: "App") -> None:
    """Draw what can be done with the tour that was saved last."""
    imgui.same_line()
    if app.replayer.on:
        if imgui.button("Stop replay"):
            app.replayer.stop()
        return
    if imgui.button("Replay"):
        app.do.replay_last()
    if app.replayer.last and not app.filming.on:
        imgui.same_line()
        if imgui.button("Make film"):
            app.filming.start(app, app.replayer.last)
