# SPDX-License-Identifier: Apache-2.0
"""The policies by name."""

from collections.abc import Callable
from functools import partial

from geopage.policies.benefit import Benefit
from geopage.policies.berkeley import Berkeley
from geopage.policies.demand import Demand
from geopage.policies.mmr import Mmr
from geopage.policies.oracle import Oracle
from geopage.policies.protocol import Policy
from geopage.policies.review import Review
from geopage.policies.strict import Strict
from geopage.policies.vgis import Vgis

REGISTRY: dict[str, Callable[[], Policy]] = {
    "benefit": Benefit,
    "demand": Demand,
    "vgis": Vgis,
    "vgis-centre": partial(Vgis, centre=True),
    "mmr": Mmr,
    "review": Review,
    "berkeley": Berkeley,
    "vgis-stepwise": partial(Vgis, skips=False),
    "strict": Strict,
    "oracle": Oracle,
}


def policy_of(name: str) -> Policy:
    """Return a new policy, by one of the names in `geopage.settings.REPLAYED`."""
    return REGISTRY[name]()
