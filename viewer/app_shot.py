# SPDX-License-Identifier: Apache-2.0
"""A picture of the view, also larger than the window, taken when all of it is there."""

from dataclasses import replace
from typing import TYPE_CHECKING

from geopage.view import ViewState
from tiles.errors import InputError
from viewer.camera import view_state
from viewer.files import free_name
from viewer.picture import write_png

if TYPE_CHECKING:
    from viewer.app import App

LARGEST_PX = 8192
LONGEST_S = 60.0


class Shot:
    """Waits until a view is settled at the picture's size, while the window lives on."""

    def __init__(self, app: "App") -> None:
        lens = app.navigator.lens
        scale = min(app.state.shot_scale, LARGEST_PX // max(lens.size_px))
        self._size_px = lens.size_px[0] * max(scale, 1), lens.size_px[1] * max(scale, 1)
        self._pose, self._lens = app.navigator.pose, replace(lens, size_px=self._size_px)
        self._began_s = app.now_s
        self._still = 0
        self._waits = not app.state.frozen  # a frozen selection is what is wanted
        if self._waits:
            app.session.pager.view(self._view(app))
        self._late = False
        text = f"picture of {self._size_px[0]} x {self._size_px[1]}: loading"
        app.say(text, 2 * LONGEST_S)

    def step(self, app: "App") -> bool:
        """Take the picture when it is time; says whether that is over."""
        pager = app.session.pager
        self._still = self._still + 1 if pager.settled else 0
        self._late = self._still < 3 and app.now_s - self._began_s > LONGEST_S
        if self._waits and self._still < 3 and not self._late:
            return False
        self._take(app)
        return True

    def _view(self, app: "App") -> ViewState:
        return view_state(self._pose, self._lens.size_px, self._lens.fov_rad, app.now_s)

    def _take(self, app: "App") -> None:
        size = app.session.renderer.size_px
        file = free_name(app.state.out, app.session.store.path.stem, ".png")
        renderer = app.session.renderer
        try:
            app.set_size(self._size_px)
            # The mark on a clicked building is for the eye, not for the picture.
            renderer.overlay = replace(app.state.overlay, picked=None)
            renderer.draw(app.session.pager.draw_list().solid(), self._view(app))
            write_png(file, renderer.read_rgb())
        except InputError as error:
            app.say(str(error))
        except RuntimeError as error:  # of the driver
            app.say(f"no picture of this size: {error}")
        except ImportError:
            app.say("pictures need Pillow: pip install 'geopage[report]'")
        else:
            partly = ", not everything was there" if self._late and self._waits else ""
            app.say(f"picture saved{partly}: {file}")
        finally:
            app.set_size(size)
            app.told.again()
