# SPDX-License-Identifier: Apache-2.0
"""From draw lists to pixels, and from flights to reports."""
