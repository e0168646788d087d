# SPDX-License-Identifier: Apache-2.0
"""What a VRT is made of: GDAL opens those files by itself, with any driver it has."""

import html
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from tiles.errors import InputError

REMOTE = re.compile(
    r"/vsi(curl|s3|gs|az|adls|oss|swift|hdfs|webhdfs)|>\s*(https?|ftp)://|^(https?|ftp)://",
    re.IGNORECASE,
)
"""What GDAL would open over a network"""
NAMED = re.compile(r"<Source(?:Filename|Dataset)\b([^>]*)>([^<]*)<")
BESIDE = (".aux.xml", ".msk", ".ovr", ".prj")
"""Endings of files that say more about another"""
MOST_DEEP = 4


def refuse_remote(path: Path, text: str) -> None:
    """Refuse a text that names what lies on a network.

    Raises
    ------
    InputError
    """
    if REMOTE.search(text):
        raise InputError(path, "names a file on a network", "download that first")


def parts_of(path: Path, known: Iterable[str]) -> Iterator[str]:
    """Return what a VRT names, each once, and what GDAL says that it is made of.

    Parameters
    ----------
    known : the files that GDAL lists
    """
    text = path.read_text(errors="replace")
    found = {name for name in known if name != str(path)}
    for ways, said in NAMED.findall(text):
        name = html.unescape(said.strip())
        beside = re.search(r"relativeToVRT\s*=\s*[\"']1", ways) is not None
        found.add(str(path.parent / name) if beside else name)
    yield from sorted(name for name in found if not name.endswith(BESIDE))
