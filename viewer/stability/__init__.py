# SPDX-License-Identifier: Apache-2.0
"""Where methods fail, and how far geopage is from it: one small function a row."""
