# SPDX-License-Identifier: Apache-2.0
import numpy as np

from geopage.object_needs import object_needs_of
from geopage.outlook import outlook
from geopage.screen_error import lens_of
from geopage.tree import U1, Tree
from tests.geopage.worlds import BLOCK_LEVEL, CITY_LEVELS, view_at
from tiles.lanes import Lane

GOALS = 4


def goals_of(trees: dict[Lane, Tree], uploaded: U1) -> list[set[int]]:
    """What each goal of one picture misses."""
    view = view_at(800.0)
    ahead = outlook(view, None, 0.0, np.zeros(1))
    town = trees[Lane.OBJECTS]
    needs = object_needs_of(town, uploaded, ahead, lens_of(view), 2.0, 2.0, GOALS)
    ends = zip(needs.start[:-1], needs.start[1:], strict=True)
    return [set(needs.rows[first:last].tolist()) for first, last in ends]


def test_coarser_goals_take_fewer_bytes_and_coarser_tiles(
    trees: dict[Lane, Tree],
) -> None:
    town = trees[Lane.OBJECTS]
    goals = goals_of(trees, np.zeros(len(town.parent), np.uint8))
    cost = [town.tile_bytes[list(goal)].sum() for goal in goals]
    deepest = [town.level[list(goal)].max(initial=0) for goal in goals]
    assert (np.diff(cost) <= 0).all()
    assert cost[-1] < cost[0] / 2
    assert deepest[0] == BLOCK_LEVEL
    assert deepest[-1] <= CITY_LEVELS[1]


def test_a_goal_misses_nothing_where_finer_tiles_are_drawn(
    trees: dict[Lane, Tree],
) -> None:
    town = trees[Lane.OBJECTS]
    nothing = np.zeros(len(town.parent), np.uint8)
    fine = goals_of(trees, nothing)[0]
    nothing[list(fine)] = 1
    assert goals_of(trees, nothing) == [set()] * GOALS
