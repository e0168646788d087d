# SPDX-License-Identifier: Apache-2.0
"""What is closed when the `with` statement that holds it ends."""

from abc import ABC, abstractmethod
from typing import Self


class Closing(ABC):
    """Is closed at the end of its `with` statement, whatever happened."""

    @abstractmethod
    def close(self) -> None:
        """Give back what is held."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
