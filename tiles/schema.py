# SPDX-License-Identifier: Apache-2.0
"""The tables of a store, and what its file must say about itself."""

APPLICATION_ID = 0x67656F70  # "geop"
FORMAT_VERSION = 7

TABLES = """
CREATE TABLE tile(
    row INTEGER PRIMARY KEY,
    lane INTEGER NOT NULL,
    cell INTEGER NOT NULL,
    body BLOB NOT NULL);
CREATE TABLE index_block(
    lane INTEGER NOT NULL,
    root INTEGER NOT NULL,                  -- cell whose subtree it holds
    body BLOB NOT NULL,                     -- INDEX records
    checksum INTEGER NOT NULL,              -- of lane, root and body
    PRIMARY KEY(lane, root)) WITHOUT ROWID;
CREATE TABLE source(
    name TEXT PRIMARY KEY,
    kind TEXT NOT NULL,                     -- terrain, imagery or buildings
    rank INTEGER NOT NULL,                  -- order of first ingest
    details TEXT NOT NULL) WITHOUT ROWID;   -- JSON: path, crs, datum, report ...
CREATE TABLE raster_block(
    source TEXT NOT NULL,
    level INTEGER NOT NULL,                 -- 0 as read, each further one halves
    row INTEGER NOT NULL,
    col INTEGER NOT NULL,
    body BLOB NOT NULL,
    PRIMARY KEY(source, level, row, col)) WITHOUT ROWID;
CREATE TABLE object(
    id INTEGER PRIMARY KEY,
    source TEXT NOT NULL,
    cell INTEGER NOT NULL,                  -- the one cell that holds it
    lon_deg REAL NOT NULL,
    lat_deg REAL NOT NULL,
    base_m REAL NOT NULL,                   -- walls' lower edge above the ellipsoid
    raised_m REAL NOT NULL,                 -- walls' lower edge above the ground
    height_m REAL NOT NULL,                 -- roof above the walls' lower edge
    dimension_m REAL NOT NULL,
    footprint BLOB NOT NULL,                -- WKB, degrees
    solid BLOB,                             -- mesh from a city model, or NULL: a prism
    attributes TEXT NOT NULL);              -- JSON, as in the source
CREATE INDEX object_by_source ON object(source);
CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
INSERT INTO meta VALUES('generation', '0');
CREATE INDEX tile_by_lane ON tile(lane);
CREATE TABLE retired(                       -- tiles that no index names any more
    row INTEGER PRIMARY KEY,
    lane INTEGER NOT NULL,
    generation INTEGER NOT NULL);           -- that stopped naming it
CREATE TABLE unfinished(                    -- what an ingest has done so far
    key TEXT PRIMARY KEY,
    body BLOB NOT NULL,
    blocks TEXT,                            -- raster blocks that no source names yet
    first_row INTEGER,                      -- tiles that no index names yet
    last_row INTEGER);
"""
