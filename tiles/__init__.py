# SPDX-License-Identifier: Apache-2.0
"""The world at rest: cells, index trees, the two tile records and the store."""
