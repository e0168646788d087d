# SPDX-License-Identifier: Apache-2.0
"""Paging: what a view draws, what it wants next, and how that gets into memory."""

__version__ = "0.1.0"
