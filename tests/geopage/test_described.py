# SPDX-License-Identifier: Apache-2.0
"""Each policy is described in a line, those of the literature with their year."""

from geopage.policies.described import described
from geopage.policies.registry import REGISTRY
from geopage.settings import REPLAYED


def test_every_policy_has_a_line_and_every_paper_its_year() -> None:
    lines = dict(line.split(maxsplit=1) for line in described(REPLAYED).splitlines())
    assert lines.keys() == REGISTRY.keys()
    for name in ("vgis", "vgis-centre", "mmr", "review", "berkeley"):
        assert any(year in lines[name] for year in ("1996", "1999", "2001"))
