# SPDX-License-Identifier: Apache-2.0
"""From elevation models and footprints to a store."""
