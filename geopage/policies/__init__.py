# SPDX-License-Identifier: Apache-2.0
"""Ways to page, of the literature and our own: see `protocol`."""
