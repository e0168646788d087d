# SPDX-License-Identifier: Apache-2.0
"""The experiments of the literature, run again: one module each. See `run`."""
