# SPDX-License-Identifier: Apache-2.0
"""The GLSL sources, put together by `viewer.passes`."""
