# SPDX-License-Identifier: Apache-2.0
"""A flight's report as scripts use it and notebooks show it."""

from pathlib import Path
from typing import Any

from viewer.page import figures

Json = dict[str, Any]


class Figures(Json):
    """A dict whose keys are attributes as well: `report.frames.p50_ms`."""

    def __getattr__(self, name: str) -> Any:
        try:
            found = self[name]
        except KeyError as error:
            raise AttributeError(f"no {name!r}; there are {', '.join(self)}") from error
        return Figures(found) if isinstance(found, dict) else found

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]


class Chart:
    """A drawing as SVG text."""

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def save(self, path: str | Path) -> None:
        """Write it to a file."""
        Path(path).write_text(self.svg, "utf-8")

    def _repr_svg_(self) -> str:
        return self.svg


class FlightReport(Figures):
    """What was measured on a flight, as in `report.json`, and its chart."""

    def __init__(self, report: Json, svg: str) -> None:
        super().__init__(report)
        self._svg = svg

    def chart(self) -> Chart:
        """Return height, frame time beside its floor, errors and memory over time."""
        return Chart(self._svg)

    def _repr_html_(self) -> str:
        return figures(self) + self._svg[self._svg.index("<svg") :]
