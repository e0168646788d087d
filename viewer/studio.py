# SPDX-License-Identifier: Apache-2.0
"""Pictures and flights for scripts and notebooks, behind `geopage.open(path)`."""

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from geopage.selection import Thresholds
from geopage.settings import MIB, PagerSettings
from geopage.style import Style, parse_style
from viewer.camera import Pose, view_state
from viewer.complete import CompleteFrames
from viewer.flown import FlightReport
from viewer.image import Image
from viewer.run import SETTLED_POSES, Run, fly
from viewer.session import Picture, Session
from viewer.still import LARGEST, finer

BUDGET_MIB = 512.0
HD = 1280, 720


class Studio:
    """Draws one store. Thread: the one that made it; its GL context stays open."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session: Session | None = None
        self._frames: CompleteFrames | None = None
        self._style: Style | None = None

    def render(
        self,
        at: tuple[float, float, float, float, float],
        *,
        size_px: tuple[int, int] = HD,
        threshold_px: float = 2.0,
        fov_deg: float = 60.0,
        above_ground: bool = True,
        style: str | Style | None = None,
    ) -> Image:
        """Draw a view with everything that it wants.

        Parameters
        ----------
        at : longitude, latitude (rad), height (m), heading, pitch (rad), see `Pose`
        above_ground : the height is; otherwise it is above the ellipsoid
        size_px : width and height
        threshold_px : largest screen error, and least size of an object
        fov_deg : vertical
        style : colours of the objects, as `--style` takes them
        """
        if not threshold_px > 0:
            raise ValueError(f"threshold_px: expected more than 0, got {threshold_px}")
        if not (min(size_px) >= 1 and max(size_px) <= LARGEST):
            raise ValueError(f"size_px: expected 1..{LARGEST}, got {size_px}")
        session, frames = self._open(finer(size_px), _style_of(style))
        pose = Pose(*at)
        if above_ground:
            ground_m = session.surface.height_at(pose.lon_rad, pose.lat_rad)
            pose = replace(pose, height_m=pose.height_m + ground_m)
        view = view_state(pose, size_px, math.radians(fov_deg))
        drawn, stats = frames.draw(view, Thresholds(threshold_px, threshold_px))
        about: dict[str, Any] = {
            "eye_height_m": pose.height_m,
            "threshold_px": drawn.threshold_px,
            "triangles": stats.triangles,
            "objects": stats.objects,
            "faults": list(frames.faults),
        }
        if session.styling:
            about["style"] = session.styling.legend
        return Image(session.renderer.read_rgb(), about)

    def _open(
        self, picture: Picture, style: Style | None
    ) -> tuple[Session, CompleteFrames]:
        """Return what draws such pictures; what drew the last one, where it can."""
        session, frames = self._session, self._frames
        if session and frames and session.picture == picture:
            if style != self._style:
                session.set_style(style)
                self._style = style
            return session, frames
        self.close()
        settings = PagerSettings(budget_bytes=int(BUDGET_MIB * MIB))
        self._session = session = Session(self._path, settings, picture, style)
        self._frames, self._style = CompleteFrames(session), style
        return session, self._frames

    def fly(  # noqa: PLR0913  (the words of a script)
        self,
        path: str | Path,
        out: str | Path | None = None,
        *,
        settled_poses: int = 0,
        size_px: tuple[int, int] = HD,
        threshold_px: float = 2.0,
        budget_mib: float = BUDGET_MIB,
        style: str | Style | None = None,
        fps: float = 0.0,
    ) -> FlightReport:
        """Fly a camera path and return what was measured.

        Parameters
        ----------
        path : of a camera path
        out : folder for the report, its table and page; None: they are not kept
        fps : frames per second to be held by coarser detail; 0: none
        settled_poses : stop at so many until each is settled; 0: fly in real time
        """
        self.close()  # its memory is not the flight's
        settings = PagerSettings(threshold_px, budget_bytes=int(budget_mib * MIB))
        with TemporaryDirectory() as scratch:
            folder = Path(out) if out is not None else Path(scratch)
            how = not settled_poses, settled_poses or SETTLED_POSES
            run = Run(Path(path), folder, *how, style=_style_of(style), fps=fps)
            report = fly(self._path, settings, Picture(size_px), run)
            return FlightReport(report, (folder / "flight.svg").read_text("utf-8"))

    def close(self) -> None:
        """Free the GPU's memory; the next picture takes it again."""
        if self._session:
            self._session.close()
        self._session = self._frames = None


def _style_of(style: str | Style | None) -> Style | None:
    return parse_style(style) if isinstance(style, str) else style
